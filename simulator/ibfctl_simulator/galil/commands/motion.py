"""Servo state, independent motion, and the settings of the axes."""

from __future__ import annotations

from ibfctl_simulator.galil import errors, starts
from ibfctl_simulator.galil.arguments import integer
from ibfctl_simulator.galil.axis import ABORTED
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.parameters import LARGEST_POSITION, PARAMETERS


def set_parameter(request: Request, name: str) -> str | None:
    """`SPA=1`, `SP 1,2`, `SPA=?`, `SP ?,?`: set or ask a setting of the axes."""
    answers = []
    for index, text in request.fields():
        axis = request.state.axes[index]
        if text == "?":
            answers.append(f"{axis.parameters[name]:.4f}".rstrip("0").rstrip("."))
            continue
        value = PARAMETERS[name].rounded(request.value(text))
        if name in ("PA", "PR", "JG"):
            starts.set_target(axis, name, value)
            continue
        if name in ("SP", "PT"):
            axis.require_still()
        axis.parameters[name] = value
        if name == "TL":
            axis.servo.torque_limit_volts = value
    return ", ".join(answers) or None


def servo_on(request: Request) -> None:
    """`SH AB`."""
    for index in request.axes():
        request.state.axes[index].servo_on()


def servo_off(request: Request) -> None:
    """`MO AB`."""
    for index in request.axes():
        request.state.axes[index].servo_off()


def begin(request: Request) -> None:
    """`BG AB`: all listed axes or none start."""
    axes = [request.state.axes[index] for index in request.axes()]
    for axis in axes:
        starts.check_begin(axis)
    for axis in axes:
        starts.begin(axis)


def stop(request: Request) -> None:
    """`ST AB`: decelerate with DC."""
    for index in request.axes():
        request.state.axes[index].stop()


def abort(request: Request) -> None:
    """`AB`: stop all axes at once and halt the programs; `AB 1`: stop the axes only."""
    form = request.text.strip()
    if form not in ("", "0", "1"):
        raise CommandError(errors.OUT_OF_RANGE)
    for axis in request.state.axes:
        axis.stop(ABORTED, at_once=True)
    if form != "1":
        request.engine.halt()


def define_position(request: Request) -> str | None:
    """`DPA=0`, `DP 0,0`, `DPA=?`."""
    answers = []
    for index, text in request.fields():
        axis = request.state.axes[index]
        if text == "?":
            answers.append(str(axis.encoder_counts))
        else:
            counts = integer(request.value(text), -LARGEST_POSITION - 1, LARGEST_POSITION)
            axis.define_position(counts)
    return ", ".join(answers) or None


def define_dual_position(request: Request) -> str | None:
    """`DEA=0`, `DE 0,0`, `DEA=?`: the auxiliary encoder or step count, which nothing moves."""
    answers = []
    for index, text in request.fields():
        axis = request.state.axes[index]
        if text == "?":
            answers.append(str(axis.dual_counts))
        else:
            axis.require_still()
            axis.dual_counts = integer(request.value(text), -LARGEST_POSITION - 1, LARGEST_POSITION)
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
    "DE": define_dual_position,
}
