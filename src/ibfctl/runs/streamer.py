"""Stream a program to a controller: fill, open the gate, begin, feed, end, and prove what was executed."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from ibfctl.errors import ControllerError, IbfctlError, RunError
from ibfctl.machine.controller import BufferStatus, MotionController
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import MotionProgram
from ibfctl.runs.counts import CountCheck
from ibfctl.runs.ledger import SegmentLedger
from ibfctl.runs.outcome import RunOutcome, RunProgress
from ibfctl.runs.preflight import check_clock, check_program
from ibfctl.runs.sentinel import Sentinel

LARGEST_PORTION, LEAST_PORTION = 64, 16
LONG_CALL_S = 0.25
PROGRESS_S = 0.1
END_GRACE_S = 0.05
STALL_S = 2.0
CLOCK_DRIFT = 2e-4
WAKE_UP_S = 0.003
PAUSE_SHARE = 16


def execute(
    program: MotionProgram,
    machine: MachineDescription,
    controller: MotionController,
    *,
    on_progress: Callable[[RunProgress], None] = lambda _: None,
    abort: threading.Event | None = None,
    time_scale: float = 1.0,
    poll_interval_s: float = 0.05,
) -> RunOutcome:
    """Run a program and return only if it was executed to the last count.

    The beam gate opens at the start point, with the buffer full, together with the motion, and is closed
    on every way out: by the end, an error, an interrupt, an abort or a lost link, and by a second thread
    before the buffer can run dry.

    Parameters
    ----------
    program
        What to execute.
    machine
        The machine that it was planned for.
    controller
        Connected; it is left connected, with the gate closed and the axes at rest and held.
    on_progress
        Called in this thread about ten times a second while the axes move.
    abort
        Setting it, from any thread, closes the gate and stops all motion at once.
    time_scale
        Controller seconds per host second: 1, but for an emulated clock that runs faster or slower.
    poll_interval_s
        Longest pause between two polls of the controller, on the host's clock.

    Raises
    ------
    AbortedError
        After `abort` was set.
    RunError
        If the run ended otherwise than as planned; the message says after how many segments.
    LimitsError, ControllerError
        If it was refused, or failed, before the gate opened.
    """
    check_program(program, machine)
    abort = abort if abort is not None else threading.Event()
    with Sentinel(controller, abort) as sentinel:
        run = _Run(program, machine, controller, sentinel, abort, on_progress, time_scale, poll_interval_s)
        try:
            return run.execute()
        except BaseException as error:
            trouble = _make_safe(controller)
            told = sentinel.error() or run.explained(error)
            if trouble:
                raise RunError(f"{told}; {trouble}", "switch the beam off by hand now") from error
            if told is error:
                raise
            raise told from error


def _make_safe(controller: MotionController) -> str:
    """Close the gate, then stop the axes; return what could not be done, or nothing."""
    try:
        controller.close_gate()
    except ControllerError as error:
        return str(error.message)  # a stop with the beam on would drill a hole; the buffer ends the motion
    try:
        controller.stop()
    except ControllerError:
        try:
            controller.abort()
        except ControllerError as error:
            return f"the gate is closed, but the axes may move until their buffer is empty ({error.message})"
    return ""


class _Run:
    """The steps of one run, in the streaming thread."""

    def __init__(
        self,
        program: MotionProgram,
        machine: MachineDescription,
        controller: MotionController,
        sentinel: Sentinel,
        abort: threading.Event,
        on_progress: Callable[[RunProgress], None],
        time_scale: float,
        poll_interval_s: float,
    ) -> None:
        self._program = program
        self._machine = machine
        self._controller = controller
        self._sentinel = sentinel
        self._abort = abort
        self._on_progress = on_progress
        self._time_scale = time_scale
        self._poll_interval_s = poll_interval_s
        self._tolerance_counts = machine.servo.position_tolerance_counts
        self._ledger = SegmentLedger(program, time_scale)
        self._check_counts = CountCheck(
            controller.buffer_places, program.RUNNING_CODE, program.COMPLETE_CODE
        )
        self._portion = LARGEST_PORTION
        self._end_sent = False
        self._began = False
        self._reported_at = 0.0
        self._reserve_s = 0.0

    def execute(self) -> RunOutcome:
        """Take all steps in order."""
        started = time.monotonic()
        self._controller.identify()
        period_s = check_clock(self._controller, self._machine.sample_period_s, self._time_scale)
        self._close_gate_timed()
        self._approach()
        self._fill()
        self._begin()
        self._feed()
        self._await_end()
        errors = self._prove()
        return RunOutcome(
            segments_sent=self._ledger.sent,
            segments_executed=self._ledger.executed,
            stop_codes=dict.fromkeys(errors, self._program.COMPLETE_CODE),
            final_position_error_counts=errors,
            minimum_buffer_margin_s=self._ledger.minimum_margin_s,
            duration_s=self._program.total_time_s,
            wall_s=time.monotonic() - started,
            sample_period_s=period_s,
        )

    def explained(self, error: BaseException) -> BaseException:
        """Say how far the run had come when the controller failed it."""
        if not self._began or not isinstance(error, IbfctlError):
            return error
        done = f"run ended after {self._ledger.executed} of {len(self._program)} segments"
        return RunError(f"{done}: {error.message}", error.hint)

    def _close_gate_timed(self) -> None:
        """Close the gate, and learn how long before the last moment the sentinel must begin to."""
        asked_at = time.monotonic()
        self._controller.close_gate()
        self._reserve_s = 2 * (time.monotonic() - asked_at) + WAKE_UP_S

    def _approach(self) -> None:
        self._sentinel.check()
        self._controller.servo_on()
        self._controller.move_to({letter: axis.start_counts for letter, axis in self._program.axes.items()})
        self._controller.start_guard(self._machine.beam_gate.guard_patience_s * self._time_scale)

    def _fill(self) -> None:
        self._controller.prepare_segments(self._program)
        while self._ledger.sent < min(len(self._program), self._controller.buffer_places):
            self._sentinel.check()
            if not self._queue(self._controller.buffer_status()):
                raise ControllerError(f"the buffers are full after {self._ledger.sent} segments")
        if len(self._program) < self._controller.buffer_places:
            self._queue_end()
        queued = self._ledger.sent + self._end_sent
        for letter, free in self._controller.buffer_status().free_places.items():
            taken = self._controller.buffer_places - free
            if taken != queued:
                raise ControllerError(f"axis {letter} took {taken} of {queued} segments")
        for letter, axis in self._controller.status().items():
            error_counts = axis.position_counts - self._program.axes[letter].start_counts
            if not axis.motor_on or abs(error_counts) > self._tolerance_counts:
                raise ControllerError(
                    f"axis {letter} does not stand at its start, but {error_counts} counts away",
                    "check servo tuning and position_tolerance_counts",
                )

    def _begin(self) -> None:
        now = time.monotonic()
        self._ledger.begin(now)
        self._began = True
        self._expect()
        self._controller.begin_segments()

    def _feed(self) -> None:
        while not self._end_sent:
            status = self._poll()
            room = min(status.free_places.values())
            if self._ledger.sent == len(self._program) and room:
                self._queue_end()
            elif self._queue(status) == room:
                self._pause()

    def _await_end(self) -> None:
        status = self._poll()
        while not self._has_ended(status):
            self._pause()
            status = self._poll()
        self._controller.close_gate()
        self._report(time.monotonic(), gate_open=False)

    def _prove(self) -> dict[str, int]:
        """Return the position errors at rest, having checked that nothing moves and nothing is missing."""
        errors = {}
        executed_segments = self._controller.buffer_status().executed_segments
        for letter, axis in self._controller.status().items():
            errors[letter] = axis.position_counts - self._program.axes[letter].end_counts
            executed = executed_segments[letter] - 1
            if axis.moving or axis.stop_code != self._program.COMPLETE_CODE or executed != len(self._program):
                raise RunError(
                    f"axis {letter} executed {executed} of {len(self._program)} segments, "
                    f"stop code {axis.stop_code}",
                    "measure the part before planning what is left",
                )
            if abs(errors[letter]) > self._tolerance_counts:
                raise RunError(
                    f"axis {letter} ended {errors[letter]} counts from its end position",
                    "check the stage and its encoder, and measure the part",
                )
        return errors

    def _has_ended(self, status: BufferStatus) -> bool:
        complete = all(code == self._program.COMPLETE_CODE for code in status.stop_codes.values())
        queued = len(self._program) + 1
        return complete and all(executed == queued for executed in status.executed_segments.values())

    def _queue(self, status: BufferStatus) -> int:
        """Send as many segments as have surely room, in portions; return how many."""
        first = self._ledger.sent
        rows = min(min(status.free_places.values()), len(self._program) - first, self._portion)
        if rows > 0:
            asked_at = time.monotonic()
            self._controller.queue_segments(self._program, first, first + rows)
            now = time.monotonic()
            self._ledger.add(rows, now)
            self._expect()
            if now - asked_at > LONG_CALL_S:
                self._portion = max(self._portion // 2, LEAST_PORTION)
        return rows

    def _queue_end(self) -> None:
        self._controller.queue_end()
        self._end_sent = True

    def _poll(self) -> BufferStatus:
        asked_at = time.monotonic()
        status = self._controller.buffer_status()
        now = time.monotonic()
        self._check_counts(status, self._ledger.sent, self._end_sent)
        self._ledger.count(max(status.executed_segments.values()), asked_at, now)
        if not self._has_ended(status):
            self._sentinel.check()
            self._check_pace(asked_at)
            self._expect()
        if now >= self._reported_at + PROGRESS_S:
            self._report(now, gate_open=True)
        return status

    def _check_pace(self, asked_at: float) -> None:
        behind_s = self._ledger.behind_s(asked_at)
        if self._end_sent and asked_at > self._ledger.latest_end_at + END_GRACE_S:
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
            self._sentinel.expect_by(self._ledger.latest_end_at + END_GRACE_S, fault=None)
        else:
            fault = f"the buffer was about to run empty after segment {self._ledger.sent}"
            self._sentinel.expect_by(self._ledger.dry_at - self._reserve_s, fault)

    def _pause(self) -> None:
        """Wait a little, and less the sooner the buffer runs dry or the motion ends."""
        left_s = self._ledger.margin_s(time.monotonic()) / self._time_scale
        self._abort.wait(min(self._poll_interval_s, max(left_s, 0.0) / PAUSE_SHARE))

    def _report(self, now: float, gate_open: bool) -> None:
        self._reported_at = now
        margin_s = max(self._ledger.margin_s(now), 0.0)
        ledger = self._ledger
        self._on_progress(RunProgress(ledger.sent, ledger.executed, len(self._program), margin_s, gate_open))
