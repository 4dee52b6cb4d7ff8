"""Questions about the axes and the controller."""

from __future__ import annotations

from collections.abc import Callable

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.axis import Axis
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import TEXTS, CommandError
from ibfctl_simulator.galil.messages import message
from ibfctl_simulator.galil.operands import ControllerValues

SHORTEST_TIME_SETTING = 62.5
LONGEST_TIME_SETTING = 20000.0


def _integers(read: Callable[[Axis], int]) -> Handler:
    def answer(request: Request) -> str:
        return ", ".join(str(read(request.controller.axes[index])) for index in request.axes())

    return answer


def tell_code(request: Request) -> str:
    """`TC`, `TC 0`, `TC 1`: the latched error code; reading it clears it."""
    form = request.text.strip() or "0"
    if form not in ("0", "1"):
        raise CommandError(errors.OUT_OF_RANGE)
    code = request.controller.error_code
    request.controller.error_code = 0
    return str(code) if form == "0" else f"{code} {TEXTS.get(code, 'Error')}".rstrip()


def show_message(request: Request) -> str:
    """`MG` values and strings."""
    values = ControllerValues(request.controller)
    return message(request.text, values, leading_blank=request.controller.settings.message_leading_blank)


def time_setting(request: Request) -> str | None:
    """`TM n`, `TM ?`: the sample period in nominal microseconds."""
    text = request.text.strip()
    if text == "?":
        return f"{request.controller.time_setting:.0f}"
    if not text:
        raise CommandError(errors.TOO_FEW_FIELDS)
    setting = request.value(text)
    if not SHORTEST_TIME_SETTING <= setting <= LONGEST_TIME_SETTING:
        raise CommandError(errors.OUT_OF_RANGE)
    for axis in request.controller.axes:
        axis.require_still()
    steps = round(setting / SHORTEST_TIME_SETTING)
    request.controller.set_time_setting(steps * SHORTEST_TIME_SETTING)
    return None


def record_layout(request: Request) -> str:
    """`QZ`: number of axes and lengths of the parts of the data record."""
    return f"{request.controller.settings.axes}, 52, 26, 36"


def identity(request: Request) -> str:
    """`^R^V`: model and firmware revision."""
    return request.controller.settings.identity


TABLE: dict[str, Handler] = {
    "TC": tell_code,
    "MG": show_message,
    "TM": time_setting,
    "QZ": record_layout,
    "\x12\x16": identity,
    "TP": _integers(lambda axis: axis.encoder_counts),
    "RP": _integers(lambda axis: axis.reference_counts),
    "TE": _integers(lambda axis: axis.error_counts),
    "TD": _integers(lambda axis: 0),
    "TV": _integers(lambda axis: round(axis.velocity_counts_s)),
    "SC": _integers(lambda axis: axis.stop_code),
}
