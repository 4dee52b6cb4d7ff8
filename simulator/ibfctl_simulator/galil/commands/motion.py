"""Servo state and independent motion."""

from __future__ import annotations

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.arguments import integer
from ibfctl_simulator.galil.axis import ABORTED
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.parameters import LARGEST_POSITION, PARAMETERS


def set_parameter(request: Request, name: str) -> str | None:
    """`SPA=1`, `SP 1,2`, `SPA=?`, `SP ?,?`: set or ask a setting of the axes."""
    controller = request.controller
    answers = []
    for index, text in request.fields():
        axis = controller.axes[index]
        if text == "?":
            answers.append(f"{axis.parameters[name]:.0f}")
            continue
        value = PARAMETERS[name](controller.time_setting).rounded(request.value(text))
        if name in ("PA", "PR", "JG"):
            axis.set_target(name, value)
            continue
        if name == "SP":
            axis.require_still()
        axis.parameters[name] = value
    return ", ".join(answers) or None


def servo_on(request: Request) -> None:
    """`SH AB`."""
    for index in request.axes():
        request.controller.axes[index].servo_on()


def servo_off(request: Request) -> None:
    """`MO AB`."""
    for index in request.axes():
        request.controller.axes[index].servo_off()


def begin(request: Request) -> None:
    """`BG AB`: all listed axes or none start."""
    axes = [request.controller.axes[index] for index in request.axes()]
    for axis in axes:
        axis.check_begin()
    for axis in axes:
        axis.begin()


def stop(request: Request) -> None:
    """`ST AB`: decelerate with DC."""
    for index in request.axes():
        request.controller.axes[index].stop()


def abort(request: Request) -> None:
    """`AB`, `AB 1`: stop all axes at once."""
    if request.text.strip() not in ("", "0", "1"):
        raise CommandError(errors.OUT_OF_RANGE)
    for axis in request.controller.axes:
        axis.stop(ABORTED, at_once=True)


def define_position(request: Request) -> str | None:
    """`DPA=0`, `DP 0,0`, `DPA=?`."""
    answers = []
    for index, text in request.fields():
        axis = request.controller.axes[index]
        if text == "?":
            answers.append(str(axis.encoder_counts))
        else:
            counts = integer(request.value(text), -LARGEST_POSITION - 1, LARGEST_POSITION)
            axis.define_position(counts)
    return ", ".join(answers) or None


def _parameter_handler(name: str) -> Handler:
    return lambda request: set_parameter(request, name)


TABLE: dict[str, Handler] = {
    **{name: _parameter_handler(name) for name in PARAMETERS},
    "SH": servo_on,
    "MO": servo_off,
    "BG": begin,
    "ST": stop,
    "AB": abort,
    "DP": define_position,
}
