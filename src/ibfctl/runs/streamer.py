"""Stream a program to a controller: fill, open the gate, begin, feed, end, and prove what was executed."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from ibfctl.errors import ControllerError, IbfctlError, RunError
from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import MotionProgram
from ibfctl.runs.feeder import Feeder
from ibfctl.runs.outcome import RunOutcome, RunProgress
from ibfctl.runs.preflight import check_clock, check_program
from ibfctl.runs.sentinel import Sentinel

WAKE_UP_S = 0.003


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
        feeder = Feeder(program, controller, sentinel, abort, on_progress, time_scale, poll_interval_s)
        run = _Run(program, machine, controller, sentinel, feeder, time_scale)
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
        controller.stop_guard()
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
        feeder: Feeder,
        time_scale: float,
    ) -> None:
        self._program = program
        self._machine = machine
        self._controller = controller
        self._sentinel = sentinel
        self._feeder = feeder
        self._time_scale = time_scale
        self._tolerance_counts = machine.servo.position_tolerance_counts
        self._began = False

    def execute(self) -> RunOutcome:
        """Take all steps in order."""
        started = time.monotonic()
        self._controller.identify()
        self._close_gate_timed()
        period_s = check_clock(self._controller, self._machine.sample_period_s, self._time_scale)
        self._approach()
        self._fill()
        self._began = True
        self._feeder.begin()
        self._controller.begin_segments()
        self._feeder.feed()
        self._feeder.await_end()
        self._controller.close_gate()
        self._feeder.report(gate_open=False)
        errors = self._prove()
        self._controller.stop_guard()
        ledger = self._feeder.ledger
        return RunOutcome(
            segments_sent=ledger.sent,
            segments_executed=ledger.executed,
            stop_codes=dict.fromkeys(errors, self._program.COMPLETE_CODE),
            final_position_error_counts=errors,
            minimum_buffer_margin_s=ledger.minimum_margin_s,
            duration_s=self._program.total_time_s,
            wall_s=time.monotonic() - started,
            sample_period_s=period_s,
        )

    def explained(self, error: BaseException) -> BaseException:
        """Say how far the run had come when the controller failed it."""
        if not self._began or not isinstance(error, IbfctlError):
            return error
        done = f"run ended after {self._feeder.ledger.executed} of {len(self._program)} segments"
        return RunError(f"{done}: {error.message}", error.hint)

    def _close_gate_timed(self) -> None:
        """Close the gate, and learn how long that takes."""
        asked_at = time.monotonic()
        self._controller.close_gate()
        self._feeder.reserve_s = 2 * (time.monotonic() - asked_at) + WAKE_UP_S

    def _approach(self) -> None:
        self._sentinel.check()
        self._controller.servo_on()
        self._controller.move_to({letter: axis.start_counts for letter, axis in self._program.axes.items()})
        self._controller.start_guard(self._machine.beam_gate.guard_patience_s * self._time_scale)

    def _fill(self) -> None:
        self._controller.prepare_segments(self._program)
        places = self._controller.buffer_places
        while self._feeder.queued < min(len(self._program), places):
            self._sentinel.check()
            if not self._feeder.send(min(self._controller.buffer_status().free_places.values())):
                raise ControllerError(f"the buffers are full after {self._feeder.queued} segments")
        if len(self._program) < places:
            self._feeder.send_end()
        for letter, free in self._controller.buffer_status().free_places.items():
            if places - free != self._feeder.queued:
                raise ControllerError(f"axis {letter} took {places - free} of {self._feeder.queued} segments")
        for letter, axis in self._controller.status().items():
            error_counts = axis.position_counts - self._program.axes[letter].start_counts
            if not axis.motor_on or abs(error_counts) > self._tolerance_counts:
                raise ControllerError(
                    f"axis {letter} does not stand at its start, but {error_counts} counts away",
                    "check servo tuning and position_tolerance_counts",
                )

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
