"""Set-up of the controller that is kept and read back, and how unasked text is sent."""

from __future__ import annotations

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.arguments import integer
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.handles import LETTERS, SERIAL
from ibfctl_simulator.galil.state import ANALOG_INPUTS

OWN_HANDLE = "I"
MARKED, PLAIN = 1, 2


def configure(request: Request) -> str | None:
    """`CN m,n,o,p,q`: polarity of limit, home and latch inputs and the like; `CN ?,?` asks."""
    answers = []
    fields = request.text.split(",")
    if len(fields) > len(request.state.configuration):
        raise CommandError(errors.OPERAND)
    for index, text in enumerate(fields):
        if text.strip() == "?":
            answers.append(f"{request.state.configuration[index]:.0f}")
        elif text.strip():
            request.state.configuration[index] = integer(request.value(text), -1, 2)
    return ", ".join(answers) or None


def analog_kind(request: Request) -> None:
    """`AQ n,m`: range of an analog input."""
    channel, comma, kind = request.text.partition(",")
    if not comma or not channel.strip() or not kind.strip():
        raise CommandError(errors.TOO_FEW_FIELDS)
    index = integer(request.value(channel), 1, ANALOG_INPUTS) - 1
    request.state.analog_kinds[index] = integer(request.value(kind), -4, 4)


def output_compare(request: Request) -> None:
    """`OCA=start,step`: accepted; no output compare pulses are made."""
    letter, equals, fields = request.text.partition("=")
    request.axes(letter)
    numbers = [integer(request.value(field), -(2**31), 2**31 - 1) for field in fields.split(",")]
    if not equals or len(numbers) > 2:
        raise CommandError(errors.OPERAND)


def extended_io(request: Request) -> None:
    """`CO n`: which extended I/O banks are outputs; a 41x3 has none."""
    _require_extended_io(request)
    request.number(0, 255)


def console(request: Request) -> None:
    """`CF A`: the handle that unasked text goes to; `CF I` the asking one, `CF S` the serial port."""
    letter = request.text.strip()
    if letter == OWN_HANDLE:
        letter = request.handle or SERIAL
    if letter not in (*LETTERS, SERIAL):
        raise CommandError(errors.OPERAND)
    request.handles.console = letter


def console_marking(request: Request) -> str | None:
    """`CW 1`: set bit 7 of unasked bytes; `CW 2`: plain; the second field (full buffer) is accepted."""
    first, _, second = request.text.partition(",")
    if first.strip() == "?":
        return str(MARKED if request.handles.marked else PLAIN)
    if not first.strip() and not second.strip():
        raise CommandError(errors.TOO_FEW_FIELDS)
    if second.strip():
        integer(request.value(second), 0, 1)
    if first.strip():
        request.handles.marked = integer(request.value(first), MARKED, PLAIN) == MARKED
    return None


def echo(request: Request) -> None:
    """`EO 0`: no echo; an echo on Ethernet does not exist."""
    request.number(0, 1)


def _require_extended_io(request: Request) -> None:
    if request.state.settings.family != "40x0":
        raise CommandError(errors.UNKNOWN_COMMAND)


TABLE: dict[str, Handler] = {
    "CN": configure,
    "AQ": analog_kind,
    "OC": output_compare,
    "CO": extended_io,
    "CF": console,
    "CW": console_marking,
    "EO": echo,
}
