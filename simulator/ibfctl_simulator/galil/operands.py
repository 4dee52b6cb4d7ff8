"""What expressions can name: `_TPA`, `TIME`, `@OUT[1]`, variables, array elements."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import lru_cache

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
        self.state = state
        self.engine = engine
        self.handles = handles

    def operand(self, name: str) -> float:
        """Value of `_XX`, `_XXA`, `_XXn` (name without the underscore) or `TIME`."""
        return float(_lookup(name)(self))

    def variable(self, name: str) -> float:
        """Value of a user variable."""
        if name not in self.state.variables:
            raise CommandError(errors.UNKNOWN_VARIABLE)
        return self.state.variables[name]

    def function(self, name: str, argument: float) -> float:
        """Value of `@NAME[argument]`."""
        number = int(argument)
        if name in FUNCTIONS:
            return FUNCTIONS[name](argument)
        if name == "OUT":
            # A client that uses no output asks for number -1.
            return 0.0 if number == -1 else self.state.output(_within(number, OUTPUTS))
        if name == "IN":
            return self.state.input(_within(number, INPUTS))
        if name == "AN":
            return self.state.analog_inputs[_within(number, ANALOG_INPUTS) - 1]
        if name == "AO":
            return self.state.analog_outputs[_within(number, ANALOG_INPUTS) - 1]
        raise CommandError(errors.BAD_FUNCTION)

    def element(self, name: str, index: float) -> float:
        """Value of an array element; its size for index -1."""
        elements = self.state.arrays.get(name)
        if elements is None:
            raise CommandError(errors.BAD_FUNCTION)
        return float(len(elements)) if index == -1 else elements[element_index(elements, index)]


Lookup = Callable[[ControllerValues], float]


@lru_cache(maxsize=4096)
def _lookup(name: str) -> Lookup:
    """How the value of an operand is found."""
    if name in STATE_OPERANDS:
        of_state = STATE_OPERANDS[name]
        return lambda values: of_state(values.state)
    if name in ENGINE_OPERANDS:
        of_engine = ENGINE_OPERANDS[name]
        return lambda values: of_engine(values.engine)
    if name == "CO":
        return _extended_io
    numbered = _NUMBERED.fullmatch(name)
    if numbered:
        kind, number = numbered[1], int(numbered[2])
        return lambda values: _numbered(values, kind, number)
    handle = _HANDLE_STATE.fullmatch(name)
    if handle:
        letter = handle[1]
        return lambda values: 0 if values.handles.get(letter) is None else TCP_SLAVE
    return _axis_lookup(name)


def _axis_lookup(name: str) -> Lookup:
    index, kind = AXIS_INDEX.get(name[2:3] or "A"), name[:2]
    read = AXIS_OPERANDS.get(kind)
    if read is None and kind in PARAMETERS:
        read = _parameter_reader(kind)
    if index is None or read is None or len(name) > 3:
        raise CommandError(errors.BAD_OPERAND)
    place, of_axis = index, read

    def look_up(values: ControllerValues) -> float:
        axes = values.state.axes
        if place >= len(axes):
            raise CommandError(errors.BAD_OPERAND)
        return of_axis(axes[place])

    return look_up


def _parameter_reader(name: str) -> Callable[[Axis], float]:
    return lambda axis: axis.parameters[name]


def _extended_io(values: ControllerValues) -> float:
    if values.state.settings.family != "40x0":
        raise CommandError(errors.BAD_OPERAND)
    return 0.0


def _numbered(values: ControllerValues, kind: str, number: int) -> float:
    if kind in ("XQ", "HX"):
        if number >= THREADS:
            raise CommandError(errors.BAD_OPERAND)
        if kind == "XQ":
            return values.engine.line_of(number)
        thread = values.engine.threads[number]
        return 0 if thread is None else 1 if thread.wait is None else 2
    stored = values.state.configuration if kind == "CN" else [0.0, *values.state.analog_kinds]
    if number >= len(stored):
        raise CommandError(errors.BAD_OPERAND)
    return stored[number]


def element_index(elements: list[float], index: float) -> int:
    """Return a valid array index; error 56 otherwise."""
    if not 0 <= int(index) < len(elements):
        raise CommandError(errors.BAD_INDEX)
    return int(index)


def _within(number: int, most: int) -> int:
    if not 1 <= number <= most:
        raise CommandError(errors.OUT_OF_RANGE)
    return number
