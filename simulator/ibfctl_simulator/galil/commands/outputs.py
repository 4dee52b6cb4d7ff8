"""Digital and analog outputs."""

from __future__ import annotations

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.arguments import integer
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.state import ANALOG_INPUTS, OUTPUTS

LARGEST_VOLTS = 9.9998


def _switch(request: Request, *, on: bool) -> None:
    request.state.set_output(request.number(1, OUTPUTS), on)


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
    request.state.set_output(bit, request.value(expression) != 0.0)


def output_port(request: Request) -> None:
    """`OP m`: the first 16 outputs as one number."""
    word = request.number(0, 0xFFFF)
    request.state.outputs = request.state.outputs & ~0xFFFF | word


def analog_output(request: Request) -> None:
    """`AO n,volts`."""
    channel, comma, volts = request.text.partition(",")
    if not comma or not channel.strip() or not volts.strip():
        raise CommandError(errors.TOO_FEW_FIELDS)
    index = integer(request.value(channel), 1, ANALOG_INPUTS) - 1
    value = request.value(volts)
    if not -LARGEST_VOLTS <= value <= LARGEST_VOLTS:
        raise CommandError(errors.OUT_OF_RANGE)
    request.state.analog_outputs[index] = value


TABLE: dict[str, Handler] = {
    "SB": set_bit,
    "CB": clear_bit,
    "OB": output_bit,
    "OP": output_port,
    "AO": analog_output,
}
