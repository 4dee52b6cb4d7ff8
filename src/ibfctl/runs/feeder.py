"""Keep the buffer fed: poll, check, send, and tell the sentinel until when all is well."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from ibfctl.errors import RunError
from ibfctl.machine.controller import BufferStatus
from ibfctl.machine.program import PvtProgram
from ibfctl.runs.counts import CountCheck
from ibfctl.runs.ledger import SegmentLedger
from ibfctl.runs.leg import Leg
from ibfctl.runs.outcome import RunProgress
from ibfctl.runs.polls import PollLog
from ibfctl.runs.rig import Rig
from ibfctl.runs.seam import ramp_down

LARGEST_PORTION, LEAST_PORTION = 64, 16
LONG_CALL_S = 0.25
PROGRESS_S = 0.1
END_GRACE_S = 0.05
STALL_S = 2.0
CLOCK_DRIFT = 2e-4
PAUSE_SHARE = 8
AHEAD_S = 4.0
"""On the host's clock: a stall of the whole host ends a run long before, and a deeper buffer makes a pause slow."""
LEAST_AHEAD_SEGMENTS = 4


class Feeder:
    """The stream of one leg.

    Parameters
    ----------
    leg
        What is streamed.
    rig
        Where to, and who watches.
    on_progress
        Called in this thread about ten times a second while the axes move.
    on_pausing
        Called when the leg is turned towards rest.

    Attributes
    ----------
    leg
        With the ramp of a pause, once there is one.
    ledger
        The account of what was sent and executed.
    log
        All polls since the begin.
    began_samples
        The controller's sample counter at the begin; 0 before.
    paused
        Whether the leg ends at a pause.
    """

    def __init__(
        self, leg: Leg, rig: Rig, on_progress: Callable[[RunProgress], None], on_pausing: Callable[[], None]
    ) -> None:
        self._rig = rig
        self._controller = rig.controller
        self._sentinel = rig.sentinel
        self._requests = rig.requests
        self._on_progress = on_progress
        self._on_pausing = on_pausing
        program = leg.program
        self._check_counts = CountCheck(rig.controller.buffer_places, program.RUNNING_CODE, program.COMPLETE_CODE)
        self._portion = LARGEST_PORTION
        self._ahead_s = AHEAD_S * rig.time_scale
        self._end_sent = False
        self._began = False
        self.began_samples = 0
        self._reported_at = 0.0
        self.leg = leg
        self.close_at = len(program)
        self.ledger = SegmentLedger(program, rig.time_scale)
        self.log = PollLog(sorted(program.axes))
        self.paused = False

    @property
    def queued(self) -> int:
        """Segments sent, the end marker included."""
        return self.ledger.sent + self._end_sent

    @property
    def all_sent(self) -> bool:
        """Whether all segments of the leg were sent."""
        return self.ledger.sent == len(self.leg.program)

    def begin(self) -> None:
        """Begin the motion; the sentinel watches from now on."""
        self.ledger.begin(time.monotonic())
        self._began = True
        self._expect()
        self._controller.begin_segments(self.leg.open_at, self.close_at)
        self._sentinel.gate_shut.clear()  # a pause at once that came in between closes the gate again
        self.began_samples = self._controller.stamps().begun or 0

    def send(self, room: int) -> int:
        """Send as many segments as have surely room, in portions that take no long time; return how many."""
        first = self.ledger.sent
        last = self.ledger.within(self._ahead_s, LEAST_AHEAD_SEGMENTS)
        rows = min(room, last - first, self._portion)
        if rows > 0:
            asked_at = time.monotonic()
            self._controller.queue_segments(self.leg.program, first, first + rows)
            now = time.monotonic()
            self.ledger.add(rows, now)
            self._expect()
            if now - asked_at > LONG_CALL_S:
                self._portion = max(self._portion // 2, LEAST_PORTION)
        return max(rows, 0)

    def send_end(self) -> None:
        """Send the end marker."""
        self._controller.queue_end()
        self._end_sent = True

    def run(self) -> None:
        """Send all that is left and the end marker, turn to rest if that is wanted, and wait for the end."""
        while not self._has_ended(status := self._poll()):
            self._turn_if_wanted()
            room = min(status.free_places.values())
            if self.all_sent and not self._end_sent and room:
                self.send_end()
            elif self._end_sent:
                self._pause()
            else:
                sent = self.send(room)
                if not sent:  # a stream that has fallen silent must not wait to be noticed until it is needed
                    self._controller.check_stream()
                if sent in (0, room):
                    self._pause()
        self._sentinel.relax()

    def report(self) -> None:
        """Write a status line."""
        self._report(self._controller.buffer_status())

    def _report(self, status: BufferStatus) -> None:
        self._reported_at = now = time.monotonic()
        margin_s, ledger, leg = max(self.ledger.margin_s(now), 0.0), self.ledger, self.leg
        done = min(status.time_samples - self.began_samples, int(leg.ends_samples[-1]))
        executed = min(max(status.executed_segments.values()), len(leg.program))
        position_mm = {
            coordinate: status.position_counts[letter] / leg.program.axes[letter].counts_per_mm
            for coordinate, letter in leg.program.coordinates.items()
        }
        self._on_progress(
            RunProgress(
                sent=ledger.sent,
                executed=executed,
                total=len(leg.program),
                margin_s=margin_s,
                gate_open=status.gate_open,
                plan_sample=max(done + leg.shift_samples, 0),
                segment=executed,
                position_mm=position_mm,
                minimum_margin_s=ledger.minimum_margin_s,
            )
        )

    def _poll(self) -> BufferStatus:
        asked_at = time.monotonic()
        self.log.ask(asked_at)
        status = self._controller.buffer_status()
        now = time.monotonic()
        self.log.add(status, asked_at, now)
        if not self._has_ended(status):
            self._sentinel.check()
        self._check_counts(status, self.ledger.sent, self._end_sent)
        self.ledger.count(max(status.executed_segments.values()), asked_at, now)
        if not self._has_ended(status):
            self._check_gate(status)
            self._check_pace(asked_at)
            self._expect()
        if now >= self._reported_at + PROGRESS_S:
            self._report(status)
        return status

    def _has_ended(self, status: BufferStatus) -> bool:
        complete = all(code == self.leg.program.COMPLETE_CODE for code in status.stop_codes.values())
        queued = len(self.leg.program) + 1
        return complete and all(executed == queued for executed in status.executed_segments.values())

    def _turn_if_wanted(self) -> None:
        """Come to rest along the path behind what was sent; a leg whose end is already queued just ends."""
        program = self.leg.program
        wanted = self._requests.pause_wanted is not None or self._sentinel.gate_shut.is_set()
        if not wanted or self.paused or self._end_sent or not isinstance(program, PvtProgram):
            return
        way = ramp_down(program, self.ledger.sent, self._rig.machine)
        if way.leave_at == len(program):
            return
        if way.leave_at > self.leg.open_at:
            self._controller.set_close_at(way.leave_at)
        else:  # the gate has not opened yet, and must not: what is counted next is the ramp
            self._sentinel.gate_shut.set()
            self._controller.close_gate()
        self.close_at = way.leave_at
        self.leg = replace(self.leg, program=way.program)
        self.ledger.replace(way.program)
        self.paused = True
        self._on_pausing()

    def _check_gate(self, status: BufferStatus) -> None:
        """The gate was read after the counts; a segment may have ended in between."""
        least, most = min(status.executed_segments.values()), max(status.executed_segments.values())
        if self._sentinel.gate_shut.is_set():
            return
        if status.gate_open and (most < self.leg.open_at - 1 or least > self.close_at + 1):
            raise RunError("the gate's output reads open where it must be closed", "see who else is connected")
        if not status.gate_open and self.leg.open_at < least and most < self.close_at - 1:
            raise RunError("the gate's output reads closed where it must be open", "see who else is connected")

    def _check_pace(self, asked_at: float) -> None:
        behind_s = self.ledger.behind_s(asked_at)
        if self._end_sent and asked_at > self.ledger.latest_end_at + END_GRACE_S:
            raise RunError("the motion did not end when it should have", "check TM and the controller's load")
        if behind_s > STALL_S + CLOCK_DRIFT * self.leg.program.total_time_s / self._rig.time_scale:
            raise RunError(
                f"controller lags {behind_s:.1f} s behind the program", "check TM and the controller's load"
            )

    def _expect(self) -> None:
        """Tell the sentinel until when all is well without another word from here."""
        if not self._began:
            return
        if self._end_sent:
            self._sentinel.expect_by(self.ledger.latest_end_at + END_GRACE_S, fault=None)
        else:
            fault = f"the buffer was about to run empty after segment {self.ledger.sent}"
            self._sentinel.expect_by(self.ledger.dry_at - self._rig.reserve_s, fault)

    def _pause(self) -> None:
        """Wait a little, and less the sooner the buffer runs dry or the motion ends."""
        left_s = self.ledger.margin_s(time.monotonic()) / self._rig.time_scale
        self._requests.abort.wait(min(self._rig.poll_interval_s, max(left_s, 0.0) / PAUSE_SHARE))
