"""What expressions can name: `_TPA`, `TIME`, `@OUT[1]`, variables, array elements."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.arguments import AXIS_INDEX
from ibfctl_simulator.galil.axis import Axis
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.handles import Handles
from ibfctl_simulator.galil.parameters import PARAMETERS
from ibfctl_simulator.galil.programs.engine import THREADS, Engine
from ibfctl_simulator.galil.state import ANALOG_INPUTS, INPUTS, OUTPUTS, State

AXIS_OPERANDS: dict[str, Callable[[Axis], float]] = {
    "PV": lambda axis: axis.buffer.free,
    "BT": lambda axis: axis.buffer.executed,
    "BG": lambda axis: axis.moving,
    "MO": lambda axis: not axis.motor_on,
    "SC": lambda axis: axis.stop_code,
    "TP": lambda axis: axis.encoder_counts,
    "TD": lambda axis: axis.dual_counts,
    "RP": lambda axis: axis.reference_counts,
    "TE": lambda axis: axis.error_counts,
    "TV": lambda axis: round(axis.velocity_counts_s),
    "TT": lambda axis: axis.servo.torque_volts,
    "DP": lambda axis: axis.encoder_counts,
    "DE": lambda axis: axis.dual_counts,
    "LF": lambda axis: not axis.limit_active("forward"),
    "LR": lambda axis: not axis.limit_active("reverse"),
    "HM": lambda axis: axis.switches.home_at(axis.physical_counts),
}

STATE_OPERANDS: dict[str, Callable[[State], float]] = {
    "TIME": lambda state: state.time,
    "TM": lambda state: state.time_setting,
    "TC": lambda state: state.error_code,
    "BN": lambda state: state.settings.serial_number,
    "CM": lambda state: state.contour.free,
    "DT": lambda state: state.contour.time_exponent,
    "CA": lambda state: 0,
}

ENGINE_OPERANDS: dict[str, Callable[[Engine], float]] = {
    "NO": lambda engine: sum(1 << thread.number for thread in engine.running),
    "ED": lambda engine: engine.error_line,
    "ED1": lambda engine: engine.error_thread,
    "IA4": lambda engine: engine.lost_handle,
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

_NUMBERED = re.compile(r"(XQ|HX|CN|AQ)(\d+)")
_HANDLE_STATE = re.compile(r"IH([A-H])2")
TCP_SLAVE = 2


class ControllerValues:
    """Looks up the names of an expression."""

    def __init__(self, state: State, engine: Engine, handles: Handles) -> None:
        self._state = state
        self._engine = engine
        self._handles = handles

    def operand(self, name: str) -> float:
        """Value of `_XX`, `_XXA`, `_XXn` (name without the underscore) or `TIME`."""
        if name in STATE_OPERANDS:
            return float(STATE_OPERANDS[name](self._state))
        if name in ENGINE_OPERANDS:
            return float(ENGINE_OPERANDS[name](self._engine))
        if name == "CO" and self._state.settings.family == "40x0":
            return 0.0
        numbered = _NUMBERED.fullmatch(name)
        if numbered:
            return self._numbered(numbered[1], int(numbered[2]))
        handle = _HANDLE_STATE.fullmatch(name)
        if handle:
            return 0.0 if self._handles.get(handle[1]) is None else float(TCP_SLAVE)
        index = AXIS_INDEX.get(name[2:3] or "A")
        if index is None or index >= len(self._state.axes) or len(name) > 3:
            raise CommandError(errors.BAD_OPERAND)
        axis, kind = self._state.axes[index], name[:2]
        if kind in AXIS_OPERANDS:
            return float(AXIS_OPERANDS[kind](axis))
        if kind in PARAMETERS:
            return float(axis.parameters[kind])
        raise CommandError(errors.BAD_OPERAND)

    def variable(self, name: str) -> float:
        """Value of a user variable."""
        if name not in self._state.variables:
            raise CommandError(errors.UNKNOWN_VARIABLE)
        return self._state.variables[name]

    def function(self, name: str, argument: float) -> float:
        """Value of `@NAME[argument]`."""
        number = int(argument)
        if name in FUNCTIONS:
            return FUNCTIONS[name](argument)
        if name == "OUT":
            # A client that uses no output asks for number -1.
            return 0.0 if number == -1 else self._state.output(_within(number, OUTPUTS))
        if name == "IN":
            return self._state.input(_within(number, INPUTS))
        if name == "AN":
            return self._state.analog_inputs[_within(number, ANALOG_INPUTS) - 1]
        if name == "AO":
            return self._state.analog_outputs[_within(number, ANALOG_INPUTS) - 1]
        raise CommandError(errors.BAD_FUNCTION)

    def element(self, name: str, index: float) -> float:
        """Value of an array element; its size for index -1."""
        elements = self._state.arrays.get(name)
        if elements is None:
            raise CommandError(errors.BAD_FUNCTION)
        return float(len(elements)) if index == -1 else elements[element_index(elements, index)]

    def _numbered(self, kind: str, number: int) -> float:
        if kind in ("XQ", "HX"):
            if number >= THREADS:
                raise CommandError(errors.BAD_OPERAND)
            if kind == "XQ":
                return float(self._engine.line_of(number))
            thread = self._engine.threads[number]
            return 0.0 if thread is None else 1.0 if thread.wait is None else 2.0
        values = self._state.configuration if kind == "CN" else [0.0, *self._state.analog_kinds]
        if number >= len(values):
            raise CommandError(errors.BAD_OPERAND)
        return values[number]


def element_index(elements: list[float], index: float) -> int:
    """Return a valid array index; error 56 otherwise."""
    if not 0 <= int(index) < len(elements):
        raise CommandError(errors.BAD_INDEX)
    return int(index)


def _within(number: int, most: int) -> int:
    if not 1 <= number <= most:
        raise CommandError(errors.OUT_OF_RANGE)
    return number
