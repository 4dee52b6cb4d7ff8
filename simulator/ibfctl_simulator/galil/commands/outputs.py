"""Digital outputs."""

from __future__ import annotations

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.arguments import integer
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.controller import OUTPUTS
from ibfctl_simulator.galil.errors import CommandError


def _switch(request: Request, *, on: bool) -> None:
    if not request.text.strip():
        raise CommandError(errors.TOO_FEW_FIELDS)
    request.controller.set_output(integer(request.value(request.text), 1, OUTPUTS), on)


def set_bit(request: Request) -> None:
    """`SB n`."""
    _switch(request, on=True)


def clear_bit(request: Request) -> None:
    """`CB n`."""
    _switch(request, on=False)


def output_bit(request: Request) -> None:
    """`OB n,expression`: set unless the expression is zero."""
    number, comma, expression = request.text.partition(",")
    if not comma or not number.strip() or not expression.strip():
        raise CommandError(errors.TOO_FEW_FIELDS)
    bit = integer(request.value(number), 1, OUTPUTS)
    request.controller.set_output(bit, request.value(expression) != 0.0)


def output_port(request: Request) -> None:
    """`OP m`: the first 16 outputs as one number."""
    word = integer(request.value(request.text), 0, 0xFFFF)
    request.controller.outputs = request.controller.outputs & ~0xFFFF | word


TABLE: dict[str, Handler] = {"SB": set_bit, "CB": clear_bit, "OB": output_bit, "OP": output_port}
