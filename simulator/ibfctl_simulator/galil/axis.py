"""One axis: its state, and how it passes samples and meets what lies on its way.

Time passes in two steps. `look` tells how many samples pass before something happens on this axis
(a profile ends, a limit is met, the following error grows too large); `take` lets samples pass. The
controller takes the smallest number of all axes, so that an event always lies at the end of a chunk
and what is done about it does not depend on how time is cut.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.outlook import LOOK_AHEAD_SAMPLES, Motion, Outlook, look_ahead
from ibfctl_simulator.galil.parameters import AxisParameters
from ibfctl_simulator.galil.phases import stop_phases
from ibfctl_simulator.galil.profiles import FloatArray, PhasedProfile, Profile
from ibfctl_simulator.galil.pvt import UNDERRUN, PvtBuffer, PvtProfile
from ibfctl_simulator.galil.servo import Servo
from ibfctl_simulator.galil.settings import SAMPLES_PER_SECOND, Settings
from ibfctl_simulator.galil.switches import Direction, Switches

MOVING, ARRIVED, STOPPED, ABORTED, OFF_ON_ERROR = 0, 1, 4, 7, 8
LIMIT_CODES: dict[Direction, int] = {"forward": 2, "reverse": 3}

Mode = Literal["none", "absolute", "relative", "jog", "tracking", "pvt", "contour", "edge", "home", "index"]
Event = Literal["limit", "position_error"]


class Axis:
    """An axis as a function of samples; knows nothing of sockets, clocks or text."""

    def __init__(self, letter: str, settings: Settings, sample: int = 0) -> None:
        self.letter = letter
        self.settings = settings
        self.sample_period_s = 1.0 / SAMPLES_PER_SECOND
        self.parameters = AxisParameters()
        self.buffer = PvtBuffer(settings.pvt_places)
        self.servo = Servo(settings.servo)
        self.switches = Switches(settings.switches)
        self.motor_on = settings.motor_on_at_start
        self.commanded_counts = 0.0
        self.velocity_counts_s = 0.0
        self.dual_counts = 0
        self.origin_counts = 0
        """Physical position of what the host calls zero."""
        self.stop_code = ARRIVED
        self.mode: Mode = "none"
        self.stopping = False
        self.home_phase = 0
        self.target: Literal["PA", "PR", "JG", "FE", "HM", "FI"] = "PA"
        """Kind of the next independent move."""
        self.events: set[Event] = set()
        """What happened since the program engine last asked."""
        self.profile: Profile | None = None
        self.search: Callable[[FloatArray, float], int | None] | None = None
        """While homing: index of the first coming physical position at which something is found."""
        self.on_found: Callable[[], None] | None = None
        self._on_ended: Callable[[], None] | None = None
        self._sample = sample
        self.error_seen = False
        """Whether the present following error was already found too large."""
        self._outlook: Outlook | None = None

    @property
    def moving(self) -> bool:
        """Whether a profile is being generated."""
        return self.profile is not None and self.profile.busy

    @property
    def quiet(self) -> bool:
        """Whether nothing changes before the next command."""
        if self.moving:
            return False
        if not self.motor_on:
            return True
        known = self.servo.faithful or self.error_too_large == self.error_seen
        return known and self.servo.settled(self.commanded_counts)

    @property
    def reference_counts(self) -> int:
        """Commanded position as an integer."""
        return round(self.commanded_counts)

    @property
    def encoder_counts(self) -> int:
        """What the encoder reads at the present sample."""
        if self.servo.faithful:
            return round(self.servo.position_counts)
        return int(self.servo.read(np.array([self.servo.position_counts]), self._sample)[0])

    @property
    def physical_counts(self) -> float:
        """Where the load is, whatever the host calls the place."""
        return self.servo.position_counts + self.origin_counts

    @property
    def error_counts(self) -> int:
        """Following error: commanded minus encoder position."""
        return self.reference_counts - self.encoder_counts

    @property
    def error_too_large(self) -> bool:
        """Whether the following error exceeds `ER`."""
        return 0 < self.parameters["ER"] < abs(self.error_counts)

    @property
    def stopping_at_limit(self) -> bool:
        """Whether the axis is being stopped because of a limit."""
        return self.stopping and self.stop_code in LIMIT_CODES.values()

    def samples_until_executed(self, segments: int) -> int | None:
        """Samples until `segments` PVT segments are over, as far as they are queued; None without PVT motion."""
        return self.profile.samples_until(segments) if isinstance(self.profile, PvtProfile) else None

    def require_still(self) -> None:
        """Raise error 7 while the axis moves."""
        if self.profile is not None:
            raise CommandError(errors.WHILE_RUNNING)

    def limit_active(self, direction: Direction) -> bool:
        """Whether the limit switch of a direction is active."""
        return self.switches.active_at(direction, self.physical_counts)

    def limit_enabled(self, direction: Direction) -> bool:
        """Whether `LD` leaves the limit switch of a direction in force."""
        return self.parameters["LD"] not in ((1, 3) if direction == "forward" else (2, 3))

    def servo_on(self) -> None:
        """Hold where the encoder says the axis is; an axis in motion goes on."""
        if self.profile is None:
            self.commanded_counts = float(self.encoder_counts)
            if self.servo.ideal and not self.motor_on:
                self.servo.place(self.commanded_counts)
        self.motor_on = True
        self.error_seen = False
        self.forget()

    def servo_off(self, code: int = STOPPED) -> None:
        """Switch the motor off; a running profile ends with `code`, and what is queued for it is lost."""
        self.end_search()
        if self.profile is not None:
            self.profile.abandon()
            self.finish(code)
        self.servo.place(self.servo.position_counts)
        self.motor_on = False
        self.forget()

    def define_position(self, counts: int) -> None:
        """Call the present commanded position `counts`; the following error stays."""
        self.require_still()
        self.shift_origin(self.reference_counts - counts)

    def shift_origin(self, by_counts: int) -> None:
        """Move the place that the host calls zero forward; the axis stays where it is."""
        self.forget()
        self.origin_counts += by_counts
        self.commanded_counts -= by_counts
        self.servo.position_counts -= by_counts
        if self.servo.frozen_counts is not None:
            self.servo.frozen_counts -= by_counts

    def run(self, profile: Profile, mode: Mode, code: int) -> None:
        """Start a profile; it may be over at once."""
        self.forget()
        self.profile, self.mode, self.stop_code, self.stopping = profile, mode, code, False
        self._settle()

    def run_phases(
        self,
        phases: list[tuple[float, float]],
        mode: Mode,
        code: int = MOVING,
        end_code: int = ARRIVED,
        end_counts: float | None = None,
    ) -> None:
        """Start phases of constant acceleration from the present position and velocity."""
        profile = PhasedProfile(
            self.commanded_counts,
            self.velocity_counts_s,
            phases,
            sample_period_s=self.sample_period_s,
            end_code=end_code,
            end_counts=end_counts,
        )
        self.run(profile, mode, code)

    def stop(self, code: int = STOPPED, *, at_once: bool = False) -> None:
        """Bring the axis to rest with DC (or at once), leaving stop code `code`; what is queued is lost."""
        self.end_search()
        self.parameters["PT"] = 0.0
        if self.profile is None:
            return
        self.profile.abandon()
        phases = [] if at_once else stop_phases(self.velocity_counts_s, self.parameters["DC"])
        self.run_phases(phases, self.mode, code, code)
        self.stopping = self.profile is not None

    def on_stopped(self, follow: Callable[[], None]) -> None:
        """Do something once the axis has come to rest, at once if it already has."""
        if self.profile is None:
            follow()
        else:
            self._on_ended = follow

    def end_search(self) -> None:
        """Forget what homing looks for."""
        self.search = self.on_found = self._on_ended = None
        self.home_phase = 0

    def finish(self, code: int) -> None:
        """End the present profile where it is."""
        self.forget()
        self.commanded_counts = float(self.reference_counts)
        if self.servo.ideal:
            self.servo.place(self.commanded_counts)
        self.velocity_counts_s = 0.0
        self.stop_code, self.stopping, self.mode = code, False, "none"
        self.profile = None
        follow, self._on_ended = self._on_ended, None
        if follow is not None:
            follow()

    def look(self, samples: int) -> int:
        """Return how many samples pass until something may happen on this axis, at most `samples`."""
        if self._outlook is None and not self.quiet:
            self._outlook = look_ahead(self, self._commanded_ahead(max(samples, LOOK_AHEAD_SAMPLES)), self._sample + 1)
        return samples if self._outlook is None else min(samples, self._outlook.left)

    def forget(self) -> None:
        """Look ahead anew: something that the coming samples depend on may have changed."""
        self._outlook = None

    def take(self, samples: int) -> Motion | None:
        """Let samples pass, at most as many as `look` has shown; None if the axis stood still."""
        outlook = self._outlook
        self._sample += samples
        if outlook is None:
            return None
        passed = slice(outlook.passed, outlook.passed + samples)
        outlook.passed += samples
        if self.profile is not None:
            self.profile.take(samples)
        if self.motor_on:
            self.servo.take(outlook.passed, outlook.load)
        if not outlook.left:
            self._outlook = None
        self._settle()
        if not outlook.left and outlook.reaction is not None:
            outlook.reaction()
        return Motion(outlook.commanded[passed], outlook.encoder[passed])

    def meet_limit(self, direction: Direction) -> None:
        """Stop, or switch off where `OE` says so."""
        self.events.add("limit")
        code = LIMIT_CODES[direction]
        if self.parameters["OE"] in (2, 3):
            self.servo_off(code)
        else:
            self.stop(code)

    def meet_error(self) -> None:
        """Note that the following error became too large, or is small again."""
        self.error_seen = not self.error_seen
        if not self.error_seen:
            return
        self.events.add("position_error")
        if self.parameters["OE"] in (1, 3):
            self.stop_code = OFF_ON_ERROR
            self.servo_off(OFF_ON_ERROR)

    def _commanded_ahead(self, samples: int) -> FloatArray:
        """Commanded positions of the coming samples; a profile that has nothing left ends before them."""
        while self.profile is not None:
            positions = self.profile.look(samples)
            if len(positions):
                return positions
            self.profile.take(0)
            self._settle()
        return np.full(samples, self.commanded_counts)

    def _settle(self) -> None:
        """Take over the state of the profile and go on with what follows its end."""
        profile = self.profile
        if profile is None:
            return
        self.commanded_counts = profile.position_counts
        self.velocity_counts_s = profile.velocity_counts_s
        if profile.end_code is None:
            return
        if profile.end_code == UNDERRUN and isinstance(profile, PvtProfile):
            self.stop(UNDERRUN, at_once=self.settings.underrun_deceleration == "instant")
        else:
            self.finish(profile.end_code)


