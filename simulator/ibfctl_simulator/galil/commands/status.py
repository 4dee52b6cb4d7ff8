"""Questions about the axes and the controller."""

from __future__ import annotations

from collections.abc import Callable

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.axis import Axis
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import TEXTS, CommandError
from ibfctl_simulator.galil.messages import NO_LINE_END, message, target

SHORTEST_TIME_SETTING = 62.5
LONGEST_TIME_SETTING = 20000.0


def _integers(read: Callable[[Axis], int]) -> Handler:
    def answer(request: Request) -> str:
        return ", ".join(str(read(request.state.axes[index])) for index in request.axes())

    return answer


def tell_code(request: Request) -> str:
    """`TC`, `TC 0`, `TC 1`: the latched error code; reading it clears it."""
    form = request.text.strip() or "0"
    if form not in ("0", "1"):
        raise CommandError(errors.OUT_OF_RANGE)
    code = request.state.error_code
    request.state.error_code = 0
    return str(code) if form == "0" else f"{code} {TEXTS.get(code, 'Error')}".rstrip()


def show_message(request: Request) -> str | None:
    """`MG` values and strings."""
    leading_blank = request.state.settings.message_leading_blank
    text = message(request.text, request.values, leading_blank=leading_blank)
    if request.thread is None:
        return text
    request.handles.emit(text + ("" if NO_LINE_END in request.text else "\r\n"), target(request.text))
    return None


def time_setting(request: Request) -> str | None:
    """`TM n`, `TM ?`: the sample period in nominal microseconds."""
    text = request.text.strip()
    if text == "?":
        return f"{request.state.time_setting:.0f}"
    if not text:
        raise CommandError(errors.TOO_FEW_FIELDS)
    setting = request.value(text)
    if not SHORTEST_TIME_SETTING <= setting <= LONGEST_TIME_SETTING:
        raise CommandError(errors.OUT_OF_RANGE)
    for axis in request.state.axes:
        axis.require_still()
    steps = round(setting / SHORTEST_TIME_SETTING)
    request.state.set_time_setting(steps * SHORTEST_TIME_SETTING)
    return None


def identity(request: Request) -> str:
    """`^R^V`: model and firmware revision."""
    return request.state.settings.identity


def switches(axis: Axis) -> int:
    """`TS`: the switch and state bits of an axis."""
    bits = {
        7: axis.moving,
        6: axis.error_too_large,
        5: not axis.motor_on,
        3: not axis.limit_active("forward"),
        2: not axis.limit_active("reverse"),
        1: axis.switches.home_at(axis.physical_counts),
    }
    return sum(1 << bit for bit, on in bits.items() if on)


def status_byte(request: Request) -> str:
    """`TB`: the state of the controller as a byte."""
    serving = {thread.serving for thread in request.engine.running}
    bits = {
        7: bool(request.engine.running),
        5: bool(request.state.contour_axes),
        4: bool(serving & {"LIMSWI", "POSERR"}),
        3: bool(request.engine.watched_inputs),
        2: "ININT" in serving,
    }
    return str(sum(1 << bit for bit, on in bits.items() if on))


def torque(request: Request) -> str:
    """`TT`: motor command in V."""
    return ", ".join(f"{request.state.axes[index].servo.torque_volts:.4f}" for index in request.axes())


def boards(request: Request) -> str:
    """`ID`: the boards, one a line."""
    settings = request.state.settings
    amplifiers = ["AMP1, 43040, 4 AXIS"] + (["AMP2, 43040, 4 AXIS"] if settings.axes > 4 else [])
    return "\r\n".join([f"FW, {settings.identity}", f"DMC, {settings.model}", *amplifiers])


TABLE: dict[str, Handler] = {
    "TC": tell_code,
    "MG": show_message,
    "TM": time_setting,
    "\x12\x16": identity,
    "TP": _integers(lambda axis: axis.encoder_counts),
    "RP": _integers(lambda axis: axis.reference_counts),
    "TE": _integers(lambda axis: axis.error_counts),
    "TD": _integers(lambda axis: axis.dual_counts),
    "TS": _integers(switches),
    "TB": status_byte,
    "TT": torque,
    "ID": boards,
    "TV": _integers(lambda axis: round(axis.velocity_counts_s)),
    "SC": _integers(lambda axis: axis.stop_code),
}
