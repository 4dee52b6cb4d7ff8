"""One axis: its settings, its PVT buffer, and the motion it is executing."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.profiles import (
    FloatArray,
    PhasedProfile,
    Profile,
    jog_phases,
    move_phases,
    stop_phases,
)
from ibfctl_simulator.galil.pvt import RUNNING, UNDERRUN, PvtBuffer, PvtProfile
from ibfctl_simulator.galil.settings import SAMPLES_PER_SECOND, Settings

MOVING, ARRIVED, STOPPED, ABORTED = 0, 1, 4, 7


@dataclass
class AxisParameters:
    """What the host sets, by command name; counts, counts/s, counts/s^2."""

    values: dict[str, float] = field(
        default_factory=lambda: {
            "SP": 25000.0,
            "AC": 256000.0,
            "DC": 256000.0,
            "PA": 0.0,
            "PR": 0.0,
            "JG": 25000.0,
            "ER": 16384.0,
            "OE": 0.0,
        }
    )

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def __setitem__(self, name: str, value: float) -> None:
        self.values[name] = value


@dataclass(frozen=True)
class Motion:
    """What one axis did during some samples.

    Attributes
    ----------
    commanded_counts : (n,) float64
    moving : (n,) bool, whether the profile generator was at work in that sample
    """

    commanded_counts: FloatArray
    moving: NDArray[np.bool_]


class Axis:
    """An axis as a function of samples; knows nothing of sockets, clocks or text."""

    def __init__(self, letter: str, settings: Settings) -> None:
        self.letter = letter
        self.settings = settings
        self.sample_period_s = 1.0 / SAMPLES_PER_SECOND
        self.parameters = AxisParameters()
        self.buffer = PvtBuffer(settings.pvt_places)
        self.motor_on = settings.motor_on_at_start
        self.commanded_counts = 0.0
        self.encoder_counts = 0
        self.velocity_counts_s = 0.0
        self.stop_code = ARRIVED
        self._profile: Profile | None = None
        self._pending = ""
        self._jogging = False

    @property
    def moving(self) -> bool:
        """Whether a profile is being generated."""
        return self._profile is not None

    @property
    def jogging(self) -> bool:
        """Whether the axis runs at a jog velocity."""
        return self.moving and self._jogging

    @property
    def reference_counts(self) -> int:
        """Commanded position as an integer."""
        return round(self.commanded_counts)

    @property
    def error_counts(self) -> int:
        """Following error: commanded minus encoder position."""
        return self.reference_counts - self.encoder_counts

    @property
    def in_pvt(self) -> bool:
        """Whether the axis executes PVT segments."""
        return isinstance(self._profile, PvtProfile)

    def require_still(self) -> None:
        """Raise error 7 while the axis moves."""
        if self.moving:
            raise CommandError(errors.WHILE_RUNNING)

    def servo_on(self) -> None:
        """Hold the present position."""
        if not self.motor_on:
            self.commanded_counts = float(self.encoder_counts)
        self.motor_on = True

    def servo_off(self) -> None:
        """Switch the motor off; a running profile ends and the PVT buffer is lost."""
        self.buffer.clear()
        if self._profile is not None:
            self._finish(STOPPED)
        self.motor_on = False

    def define_position(self, counts: int) -> None:
        """Call the present commanded position `counts`; the following error stays."""
        self.require_still()
        error = self.error_counts
        self.commanded_counts = float(counts)
        self.encoder_counts = counts - error

    def set_target(self, name: str, counts: float) -> None:
        """Choose the kind of the next independent move: `PA`, `PR` or `JG`."""
        if name == "JG" and self.moving:
            if not self._jogging:
                raise CommandError(errors.NOT_JOGGING)
            self.parameters["JG"] = counts
            self._start_jog()
            return
        self.require_still()
        self.parameters[name] = counts
        self._pending = name

    def check_begin(self) -> None:
        """Raise the error that a `BG` on this axis would give."""
        if not self.motor_on:
            raise CommandError(errors.MOTOR_OFF)
        if self.moving:
            raise CommandError(errors.ALREADY_RUNNING)

    def begin(self) -> None:
        """Start the independent move chosen last."""
        if self._pending == "JG":
            self._start_jog()
            return
        target = self.parameters["PA"]
        if self._pending == "PR":
            target = self.commanded_counts + self.parameters["PR"]
        elif self._pending != "PA":
            target = self.commanded_counts
        speed = max(self.parameters["SP"], 1.0)
        phases = move_phases(
            target - self.commanded_counts, 0.0, speed, self.parameters["AC"], self.parameters["DC"]
        )
        self._run_phases(phases, MOVING, ARRIVED, end_counts=float(round(target)))

    def check_begin_pvt(self) -> None:
        """Raise the error that a `BT` on this axis would give."""
        if not self.motor_on:
            raise CommandError(self.settings.begin_motor_off_error)
        if self.moving:
            raise CommandError(self.settings.begin_running_error)
        if not self.buffer.waiting and self.settings.begin_empty_error is not None:
            raise CommandError(self.settings.begin_empty_error)

    def begin_pvt(self) -> None:
        """Start executing the buffered segments with the next sample."""
        self._run(PvtProfile(self.buffer, self.commanded_counts, self.sample_period_s), RUNNING)

    def stop(self, code: int = STOPPED, *, at_once: bool = False) -> None:
        """Bring the axis to rest with DC (or at once), leaving stop code `code`; PVT segments are lost."""
        self.buffer.clear()
        if self._profile is None:
            return
        phases = [] if at_once else stop_phases(self.velocity_counts_s, self.parameters["DC"])
        self._run_phases(phases, code, code)

    def advance(self, samples: int) -> Motion | None:
        """Move on by `samples`; None if the axis stood still all the time."""
        if self._profile is None:
            return None
        commanded = np.empty(samples)
        moving = np.zeros(samples, dtype=np.bool_)
        done = 0
        while self._profile is not None and done < samples:
            profile = self._profile
            positions = profile.look(samples - done)
            profile.take(len(positions))
            commanded[done : done + len(positions)] = positions
            moving[done : done + len(positions)] = True
            done += len(positions)
            self._settle(profile)
        commanded[done:] = self.commanded_counts
        self.encoder_counts = self.reference_counts
        return Motion(commanded, moving)

    def _start_jog(self) -> None:
        target = self.parameters["JG"]
        phases = jog_phases(self.velocity_counts_s, target, self.parameters["AC"], self.parameters["DC"])
        self._run_phases(phases, MOVING, ARRIVED)
        self._jogging = True

    def _run_phases(
        self, phases: list[tuple[float, float]], code: int, end_code: int, end_counts: float | None = None
    ) -> None:
        profile = PhasedProfile(
            self.commanded_counts,
            self.velocity_counts_s,
            phases,
            sample_period_s=self.sample_period_s,
            end_code=end_code,
            end_counts=end_counts,
        )
        self._run(profile, code)

    def _run(self, profile: Profile, code: int) -> None:
        self._profile = profile
        self._jogging = False
        self.stop_code = code
        self._settle(profile)

    def _settle(self, profile: Profile) -> None:
        """Take over the state of `profile` and go on with what follows its end."""
        self.commanded_counts = profile.position_counts
        self.velocity_counts_s = profile.velocity_counts_s
        if profile.end_code is None:
            return
        if profile.end_code == UNDERRUN and isinstance(profile, PvtProfile):
            self.stop(UNDERRUN, at_once=self.settings.underrun_deceleration == "instant")
        else:
            self._finish(profile.end_code)

    def _finish(self, code: int) -> None:
        self.commanded_counts = float(self.reference_counts)
        self.encoder_counts = self.reference_counts
        self.velocity_counts_s = 0.0
        self.stop_code = code
        self._jogging = False
        self._profile = None
