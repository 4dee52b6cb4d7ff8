"""Trippoints: what a program (or a patient client) can wait for."""

from __future__ import annotations

from collections.abc import Callable

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.arguments import integer
from ibfctl_simulator.galil.axis import Axis
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.programs.thread import Wait
from ibfctl_simulator.galil.state import INPUTS

LONGEST_WAIT_MS = 2_147_483_647


def wait_time(request: Request) -> Wait:
    """`WT n`: n nominal milliseconds, which are samples at TM 1000."""
    return _until(request, request.state.sample + _samples(request, request.number(0, LONGEST_WAIT_MS)))


def at_time(request: Request) -> Wait | None:
    """`AT 0` sets the reference; `AT n` waits until n ms after it; `AT -n` does so and moves it there."""
    milliseconds = request.number(-LONGEST_WAIT_MS, LONGEST_WAIT_MS)
    if milliseconds == 0:
        request.engine.reference_sample = request.state.sample
        return None
    due = request.engine.reference_sample + _samples(request, abs(milliseconds))
    if milliseconds < 0:
        request.engine.reference_sample = due
    return _until(request, due)


def after_motion(request: Request) -> Wait:
    """`AM AB`, `MC AB`: until the profiles of the axes have ended."""
    axes = [request.state.axes[index] for index in request.axes()]
    return Wait(lambda: all(axis.profile is None for axis in axes))


def after_input(request: Request) -> Wait:
    """`AI n`: until input n is high; `AI -n`: until it is low."""
    number = request.number(-INPUTS, INPUTS)
    if number == 0:
        raise CommandError(errors.OUT_OF_RANGE)
    state = request.state
    return Wait(lambda: state.input(abs(number)) == (number > 0))


def _crossing(reached: Callable[[Axis, float, float], bool]) -> Handler:
    """A wait for a position: `reached` is given the axis, the place, and where the axis was."""

    def wait(request: Request) -> Wait:
        fields = request.fields()
        if len(fields) != 1:
            raise CommandError(errors.OPERAND)
        [(index, text)] = fields
        axis = request.state.axes[index]
        place = integer(request.value(text), -(2**31), 2**31 - 1)
        start = axis.commanded_counts
        return Wait(lambda: axis.profile is None or reached(axis, place, start), poll=True)

    return wait


def _past(axis: Axis, place: float, start: float) -> bool:
    return axis.commanded_counts >= place if place >= start else axis.commanded_counts <= place


def _gone(axis: Axis, distance: float, start: float) -> bool:
    return abs(axis.commanded_counts - start) >= abs(distance)


def _samples(request: Request, milliseconds: int) -> int:
    return round(milliseconds * 1000.0 / request.state.time_setting)


def _until(request: Request, due: int) -> Wait:
    state = request.state
    return Wait(lambda: state.sample >= due, due=due)


TABLE: dict[str, Handler] = {
    "WT": wait_time,
    "AT": at_time,
    "AM": after_motion,
    "MC": after_motion,
    "AI": after_input,
    "AP": _crossing(_past),
    "AD": _crossing(_gone),
}
