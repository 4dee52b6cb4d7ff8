"""What expressions can name: `_TPA`, `TIME`, `@OUT[1]`, variables."""

from __future__ import annotations

import math
from collections.abc import Callable

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.arguments import AXIS_INDEX
from ibfctl_simulator.galil.axis import Axis
from ibfctl_simulator.galil.controller import OUTPUTS, Controller
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.parameters import PARAMETERS

AXIS_OPERANDS: dict[str, Callable[[Axis], float]] = {
    "PV": lambda axis: axis.buffer.free,
    "BT": lambda axis: axis.buffer.executed,
    "BG": lambda axis: axis.moving,
    "MO": lambda axis: not axis.motor_on,
    "SC": lambda axis: axis.stop_code,
    "TP": lambda axis: axis.encoder_counts,
    "TD": lambda axis: 0,
    "RP": lambda axis: axis.reference_counts,
    "TE": lambda axis: axis.error_counts,
    "TV": lambda axis: round(axis.velocity_counts_s),
    "DP": lambda axis: axis.encoder_counts,
}

CONTROLLER_OPERANDS: dict[str, Callable[[Controller], float]] = {
    "TIME": lambda controller: controller.samples,
    "TM": lambda controller: controller.time_setting,
    "TC": lambda controller: controller.error_code,
    "BN": lambda controller: controller.settings.serial_number,
}

FUNCTIONS: dict[str, Callable[[float], float]] = {
    "ABS": abs,
    "INT": math.trunc,
    "FRAC": lambda value: value - math.trunc(value),
    "RND": lambda value: math.floor(value + 0.5),
    "SQR": lambda value: math.sqrt(abs(value)),
    "SIN": lambda degrees: math.sin(math.radians(degrees)),
    "COS": lambda degrees: math.cos(math.radians(degrees)),
    "COM": lambda value: ~int(value),
}


class ControllerValues:
    """Looks up the names of an expression in a controller."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller

    def operand(self, name: str) -> float:
        """Value of `_XX`, `_XXA` (name without the underscore) or `TIME`."""
        of_controller = CONTROLLER_OPERANDS.get(name)
        if of_controller is not None:
            return float(of_controller(self._controller))
        index = AXIS_INDEX.get(name[2:3] or "A")
        if index is None or index >= len(self._controller.axes) or len(name) > 3:
            raise CommandError(errors.BAD_OPERAND)
        axis, kind = self._controller.axes[index], name[:2]
        if kind in AXIS_OPERANDS:
            return float(AXIS_OPERANDS[kind](axis))
        if kind in PARAMETERS:
            return float(axis.parameters[kind])
        raise CommandError(errors.BAD_OPERAND)

    def variable(self, name: str) -> float:
        """Value of a user variable."""
        if name not in self._controller.variables:
            raise CommandError(errors.UNKNOWN_VARIABLE)
        return self._controller.variables[name]

    def function(self, name: str, argument: float) -> float:
        """Value of `@NAME[argument]`."""
        if name in ("IN", "OUT"):
            return float(self._bit(name, argument))
        if name not in FUNCTIONS:
            raise CommandError(errors.BAD_FUNCTION)
        return FUNCTIONS[name](argument)

    def element(self, name: str, index: float) -> float:
        """Arrays are not dimensioned: error 57."""
        raise CommandError(errors.BAD_FUNCTION)

    def _bit(self, name: str, argument: float) -> int:
        number = int(argument)
        if number == -1:  # a client that uses no output asks for this one
            return 0
        if not 1 <= number <= OUTPUTS:
            raise CommandError(errors.OUT_OF_RANGE)
        return self._controller.input(number) if name == "IN" else self._controller.output(number)
