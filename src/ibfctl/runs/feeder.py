"""Keep the buffer fed: poll, check, send, and tell the sentinel until when all is well."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from ibfctl.errors import RunError
from ibfctl.machine.controller import BufferStatus, MotionController
from ibfctl.machine.program import MotionProgram
from ibfctl.runs.counts import CountCheck
from ibfctl.runs.ledger import SegmentLedger
from ibfctl.runs.outcome import RunProgress
from ibfctl.runs.sentinel import Sentinel

LARGEST_PORTION, LEAST_PORTION = 64, 16
LONG_CALL_S = 0.25
PROGRESS_S = 0.1
END_GRACE_S = 0.05
STALL_S = 2.0
CLOCK_DRIFT = 2e-4
PAUSE_SHARE = 8


class Feeder:
    """The stream of one run.

    Parameters
    ----------
    program, controller, sentinel
        What is streamed, where to, and who watches.
    abort
        Ends pauses at once.
    on_progress, time_scale, poll_interval_s
        As in `ibfctl.runs.streamer.execute`.

    Attributes
    ----------
    ledger
        The account of what was sent and executed.
    reserve_s
        How long before the last moment, on the host's clock, the sentinel must begin to close the gate.
    """

    def __init__(
        self,
        program: MotionProgram,
        controller: MotionController,
        sentinel: Sentinel,
        abort: threading.Event,
        on_progress: Callable[[RunProgress], None],
        time_scale: float,
        poll_interval_s: float,
    ) -> None:
        self._program = program
        self._controller = controller
        self._sentinel = sentinel
        self._abort = abort
        self._on_progress = on_progress
        self._time_scale = time_scale
        self._poll_interval_s = poll_interval_s
        self._check_counts = CountCheck(controller.buffer_places, program.RUNNING_CODE, program.COMPLETE_CODE)
        self._portion = LARGEST_PORTION
        self._end_sent = False
        self._began = False
        self._reported_at = 0.0
        self.ledger = SegmentLedger(program, time_scale)
        self.reserve_s = 0.0

    @property
    def queued(self) -> int:
        """Segments sent, the end marker included."""
        return self.ledger.sent + self._end_sent

    @property
    def all_sent(self) -> bool:
        """Whether all segments of the program were sent."""
        return self.ledger.sent == len(self._program)

    def begin(self) -> None:
        """Note that the motion begins, and have the sentinel watch from now on."""
        self.ledger.begin(time.monotonic())
        self._began = True
        self._expect()

    def send(self, room: int) -> int:
        """Send as many segments as have surely room, in portions that take no long time; return how many."""
        first = self.ledger.sent
        rows = min(room, len(self._program) - first, self._portion)
        if rows > 0:
            asked_at = time.monotonic()
            self._controller.queue_segments(self._program, first, first + rows)
            now = time.monotonic()
            self.ledger.add(rows, now)
            self._expect()
            if now - asked_at > LONG_CALL_S:
                self._portion = max(self._portion // 2, LEAST_PORTION)
        return rows

    def send_end(self) -> None:
        """Send the end marker."""
        self._controller.queue_end()
        self._end_sent = True

    def feed(self) -> None:
        """Send all that is left, and the end marker."""
        while not self._end_sent:
            room = min(self._poll().free_places.values())
            if self.all_sent and room:
                self.send_end()
            elif self.send(room) == room:
                self._pause()

    def await_end(self) -> None:
        """Wait until every axis says that it has executed everything and stopped as it should."""
        while not self._has_ended(self._poll()):
            self._pause()

    def report(self, gate_open: bool) -> None:
        """Write a status line."""
        self._reported_at = now = time.monotonic()
        margin_s, ledger = max(self.ledger.margin_s(now), 0.0), self.ledger
        self._on_progress(RunProgress(ledger.sent, ledger.executed, len(self._program), margin_s, gate_open))

    def _poll(self) -> BufferStatus:
        asked_at = time.monotonic()
        status = self._controller.buffer_status()
        now = time.monotonic()
        self._check_counts(status, self.ledger.sent, self._end_sent)
        self.ledger.count(max(status.executed_segments.values()), asked_at, now)
        if not self._has_ended(status):
            self._sentinel.check()
            self._check_pace(asked_at)
            self._expect()
        if now >= self._reported_at + PROGRESS_S:
            self.report(gate_open=True)
        return status

    def _has_ended(self, status: BufferStatus) -> bool:
        complete = all(code == self._program.COMPLETE_CODE for code in status.stop_codes.values())
        queued = len(self._program) + 1
        return complete and all(executed == queued for executed in status.executed_segments.values())

    def _check_pace(self, asked_at: float) -> None:
        behind_s = self.ledger.behind_s(asked_at)
        if self._end_sent and asked_at > self.ledger.latest_end_at + END_GRACE_S:
            raise RunError("the motion did not end when it should have", "check TM and the controller's load")
        if behind_s > STALL_S + CLOCK_DRIFT * self._program.total_time_s / self._time_scale:
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
            self._sentinel.expect_by(self.ledger.dry_at - self.reserve_s, fault)

    def _pause(self) -> None:
        """Wait a little, and less the sooner the buffer runs dry or the motion ends."""
        left_s = self.ledger.margin_s(time.monotonic()) / self._time_scale
        self._abort.wait(min(self._poll_interval_s, max(left_s, 0.0) / PAUSE_SHARE))
