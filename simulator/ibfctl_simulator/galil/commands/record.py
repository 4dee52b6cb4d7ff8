"""The data record and its layout."""

from __future__ import annotations

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.arguments import integer
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.handles import LETTERS
from ibfctl_simulator.galil.record import encode

LONGEST_PERIOD_SAMPLES = 30000


def layout(request: Request) -> str:
    """`QZ`: number of axes and lengths of the parts of the data record."""
    return f"{request.state.settings.axes}, 52, 26, 36"


def ask(request: Request) -> bytes:
    """`QR`: the record, and nothing between it and the prompt."""
    if request.text.strip():
        request.axes()  # a choice of blocks is accepted; all are sent
    return encode(request.state, request.handles, request.engine)


def push(request: Request) -> None:
    """`DR n, h`: send the record every n samples to handle number h (0 is A); `DR 0` ends it."""
    period, _, handle = request.text.partition(",")
    if not period.strip():
        raise CommandError(errors.TOO_FEW_FIELDS)
    samples = integer(request.value(period), 0, LONGEST_PERIOD_SAMPLES)
    shortest = 2 if request.state.settings.family == "40x0" else 8
    if 0 < samples < shortest:
        raise CommandError(errors.OUT_OF_RANGE)
    number = integer(request.value(handle), 0, len(LETTERS) - 1) if handle.strip() else 0
    request.pusher.start(samples, LETTERS[number], request.state.sample)


TABLE: dict[str, Handler] = {"QZ": layout, "QR": ask, "DR": push}
