"""Contour mode: `CM`, `CD`, `DT`."""

from __future__ import annotations

from collections import deque

from ibfctl_simulator.galil import errors, starts
from ibfctl_simulator.galil.arguments import AXIS_INDEX, integer
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.programs.thread import Wait

LARGEST_MOVE_COUNTS = 32762
LONGEST_EXPONENT = 8
PAUSE = -1


def enter(request: Request) -> str | None:
    """`CM AB`: the listed axes follow contour records; `CM ?` asks for the free places."""
    state = request.state
    if request.text.strip() == "?":
        return str(state.contour.free)
    chosen = request.axes()
    axes = [state.axes[index] for index in chosen]
    if any(axis.mode == "contour" for axis in state.axes):
        raise CommandError(errors.WHILE_CONTOURING)
    for axis in axes:
        axis.require_still()
        if not axis.motor_on:
            raise CommandError(errors.MOTOR_OFF)
    state.contour.waiting = {index: deque() for index in chosen}
    state.contour.executed = 0
    for index, axis in zip(chosen, axes, strict=True):
        starts.begin_contour(axis, index, state.contour)
    return None


def add_record(request: Request) -> None:
    """`CD a,b`, `CD a,b=n`, `CDA=n`: moves of the contour axes over 2^n samples; `=0` ends the contour."""
    queue, state = request.state.contour, request.state
    contouring = [index for index in queue.waiting if state.axes[index].mode == "contour"]
    if not contouring:
        raise CommandError(errors.CONTOUR_RANGE)
    moves, time = _moves(request)
    if any(index not in contouring for index in moves):
        raise CommandError(errors.OPERAND)
    samples = _samples(request, time)
    if queue.free == 0:
        raise CommandError(errors.SEGMENTS_FULL)
    for index in contouring:
        queue.waiting[index].append((moves.get(index, 0), samples))


def set_time(request: Request) -> str | None:
    """`DT n`: time of the records that give none, 2^n samples; `DT -1` pauses the contour."""
    if request.text.strip() == "?":
        return str(request.state.contour.time_exponent)
    request.state.contour.time_exponent = request.number(PAUSE, LONGEST_EXPONENT)
    return None


def wait_for_place(request: Request) -> Wait:
    """`WC`: wait until the next record can be taken."""
    queue = request.state.contour
    return Wait(lambda: queue.free > 0, poll=True)


def _moves(request: Request) -> tuple[dict[int, int], str]:
    """Counts by axis, and the text of the time."""
    text, _, time = request.text.strip().partition("=")
    if not text:
        raise CommandError(errors.TOO_FEW_FIELDS)
    if text in AXIS_INDEX:
        [index] = request.axes(text)
        move, _, time = time.partition("=")
        return {index: _move(request, move)}, time
    fields = text.split(",")
    return {index: _move(request, field) for index, field in enumerate(fields) if field.strip()}, time


def _move(request: Request, text: str) -> int:
    try:
        return integer(request.value(text), -LARGEST_MOVE_COUNTS, LARGEST_MOVE_COUNTS)
    except CommandError as error:
        raise CommandError(errors.CONTOUR_RANGE if error.code == errors.OUT_OF_RANGE else error.code) from error


def _samples(request: Request, time: str) -> int:
    """Length of a record; 0 ends the contour."""
    exponent = request.state.contour.time_exponent
    if time.strip():
        exponent = integer(request.value(time), 0, LONGEST_EXPONENT)
        if exponent == 0:
            return 0
    elif exponent == 0:
        return 0
    elif exponent == PAUSE:
        raise CommandError(errors.NO_TIME)
    return int(2**exponent)


TABLE: dict[str, Handler] = {"CM": enter, "CD": add_record, "DT": set_time, "WC": wait_for_place}
