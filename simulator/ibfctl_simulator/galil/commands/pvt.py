"""PVT segments: `PV` and `BT`."""

from __future__ import annotations

from ibfctl_simulator.galil import errors, starts
from ibfctl_simulator.galil.arguments import axis_index, integer
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.pvt import Segment

LARGEST_MOVE_COUNTS = 44_000_000
FASTEST_COUNTS_S = 22_000_000
LONGEST_SAMPLES = 2048
CLEAR = -1


def add_segment(request: Request) -> str | None:
    """`PVA=p,v,t`; `0,0,0` marks the end, `0,0,-1` empties the buffer, `PVA=?` asks for the free places."""
    letter, _, text = request.text.strip().partition("=")
    settings = request.state.settings
    axis = request.state.axes[axis_index(letter.strip(), settings.axes, settings.missing_axis_error)]
    if text.strip() == "?":
        return str(axis.buffer.free)
    move, velocity, time = _three_numbers(request, text)
    if (move, velocity, time) == (0, 0, CLEAR):
        axis.buffer.clear()
        axis.forget()
        return None
    segment = Segment(
        integer(move, -LARGEST_MOVE_COUNTS, LARGEST_MOVE_COUNTS),
        integer(velocity, -FASTEST_COUNTS_S, FASTEST_COUNTS_S),
        integer(time, 0, LONGEST_SAMPLES),
    )
    if segment.time_samples == 0 and segment != (0, 0, 0):
        raise CommandError(errors.OUT_OF_RANGE)
    too_short = 0 < segment.time_samples < settings.pvt_minimum_samples
    if too_short or (settings.pvt_even_samples and segment.time_samples % 2):
        raise CommandError(errors.OUT_OF_RANGE)
    if axis.buffer.free == 0:
        if settings.pvt_full_error:
            raise CommandError(settings.pvt_full_error)
        return None
    axis.buffer.add(segment)
    return None


def begin(request: Request) -> None:
    """`BT AB`: all listed axes start on the same sample; none listed means all that have segments."""
    state = request.state
    axes = [state.axes[index] for index in request.axes()]
    if not request.text.strip():
        axes = [axis for axis in axes if axis.buffer.waiting]
        if not axes and state.settings.begin_empty_error:
            raise CommandError(state.settings.begin_empty_error)
    for axis in axes:
        starts.check_begin_pvt(axis)
    for axis in axes:
        starts.begin_pvt(axis)


def _three_numbers(request: Request, text: str) -> tuple[float, float, float]:
    fields = text.split(",")
    if len(fields) < 3 or not all(field.strip() for field in fields):
        raise CommandError(errors.TOO_FEW_FIELDS)
    if len(fields) > 3:
        raise CommandError(errors.OPERAND)
    try:
        return int(fields[0]), int(fields[1]), int(fields[2])
    except ValueError:
        return request.value(fields[0]), request.value(fields[1]), request.value(fields[2])


TABLE: dict[str, Handler] = {"PV": add_segment, "BT": begin}
