"""Stream a program to a controller in one go, without a way to pause."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import MotionProgram
from ibfctl.runs.leg import Leg
from ibfctl.runs.motion import execute_leg
from ibfctl.runs.outcome import RunOutcome, RunProgress
from ibfctl.runs.preflight import check_clock, check_program
from ibfctl.runs.pulse import Pulse
from ibfctl.runs.requests import Requests
from ibfctl.runs.rig import Rig
from ibfctl.runs.sentinel import Sentinel


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
    started = time.monotonic()
    requests = Requests(abort)
    sentinel = Sentinel(controller, requests)
    rig = Rig(machine, controller, requests, sentinel, time_scale, poll_interval_s)
    with sentinel, Pulse(controller, rig.guarded):
        period_s = _greet(rig)
        outcome = execute_leg(Leg(program), rig, on_progress=on_progress)
    if outcome.error is not None:
        raise outcome.error
    return RunOutcome(
        segments_sent=outcome.sent,
        segments_executed=outcome.executed,
        stop_codes=outcome.stop_codes,
        final_position_error_counts=outcome.position_error_counts,
        minimum_buffer_margin_s=outcome.minimum_margin_s,
        duration_s=program.total_time_s,
        wall_s=time.monotonic() - started,
        sample_period_s=period_s,
    )


def _greet(rig: Rig) -> float:
    """Close the gate, and see that the right controller with the right clock answers; return its sample period."""
    try:
        rig.controller.identify()
        rig.close_gate_timed()
        return check_clock(rig.controller, rig.machine.sample_period_s, rig.time_scale)
    except BaseException as error:
        rig.make_safe()
        raise rig.sentinel.error() or error from error
