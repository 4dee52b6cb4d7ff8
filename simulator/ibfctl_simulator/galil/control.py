"""The back door: faults and time, one line each, for tests and demonstrations.

A line is a name and `key=value` pairs, e.g. `delay seconds=0.05 handle=A`. The control port answers
`ok` or `error: ...`. `COMMANDS` lists all lines; the simulator's README explains them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ibfctl_simulator.galil.axis import Axis
from ibfctl_simulator.galil.clock import SteppedClock
from ibfctl_simulator.galil.faults import ALL
from ibfctl_simulator.galil.handles import LETTERS
from ibfctl_simulator.galil.server import Emulator
from ibfctl_simulator.galil.state import ANALOG_INPUTS
from ibfctl_simulator.galil.switches import Direction

ABORT_INPUT, AMPLIFIER_FAULT = 6, 15
DIRECTIONS: tuple[Direction, ...] = ("forward", "reverse")


@dataclass(frozen=True)
class ControlCommand:
    """One line: the types of its keys, their defaults, and what it does."""

    act: Callable[..., None]
    keys: Mapping[str, Callable[[str], Any]]
    defaults: Mapping[str, Any]


def apply_command(emulator: Emulator, line: str) -> None:
    """Carry out one line.

    Raises
    ------
    ValueError
        If the line is not understood; the message says why.
    """
    name, *pairs = line.split()
    command = COMMANDS.get(name)
    if command is None:
        raise ValueError(f"unknown command {name!r}; known are {', '.join(sorted(COMMANDS))}")
    values = dict(command.defaults)
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or key not in command.keys:
            raise ValueError(f"{name}: {pair!r} is no key=value with a key of {', '.join(command.keys) or 'none'}")
        try:
            values[key] = command.keys[key](text)
        except ValueError as error:
            raise ValueError(f"{name}: {key}={text}: {error}") from error
    missing = [key for key in command.keys if key not in values]
    if missing:
        raise ValueError(f"{name}: {missing[0]} is missing")
    for axis in emulator.controller.state.axes:
        axis.forget()
    command.act(emulator, **values)


def _handle(text: str) -> str:
    if text != ALL and text not in LETTERS:
        raise ValueError("no handle A to H, nor *")
    return text


def _seconds(text: str) -> float:
    value = float(text)
    if not 0.0 <= value < float("inf"):
        raise ValueError("not a time in s")
    return value


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise ValueError("not positive")
    return value


def _count(text: str) -> int:
    value = int(text)
    if value < 0:
        raise ValueError("negative")
    return value


def _side(text: str) -> Direction:
    for direction in DIRECTIONS:
        if text == direction:
            return direction
    raise ValueError("neither forward nor reverse")


def _axis(emulator: Emulator, letter: str) -> Axis:
    for axis in emulator.controller.state.axes:
        if axis.letter == letter:
            return axis
    raise ValueError(f"no axis {letter!r}")


def _reset(emulator: Emulator, handle: str) -> None:
    for open_handle in emulator.controller.handles.all():
        if handle in (ALL, open_handle.letter):
            open_handle.reset()
            emulator.controller.lost(open_handle.letter)


def _skew(emulator: Emulator, axis: str, segments: int) -> None:
    _axis(emulator, axis).buffer.lose_next = segments


def _limit(emulator: Emulator, axis: str, side: Direction) -> None:
    _axis(emulator, axis).switches.forced.add(side)


def _position_error(emulator: Emulator, axis: str, counts: int) -> None:
    _axis(emulator, axis).servo.disturbance_counts = counts


def _encoder(emulator: Emulator, axis: str) -> None:
    failed = _axis(emulator, axis)
    failed.servo.frozen_counts = failed.encoder_counts


def _abort_input(emulator: Emulator) -> None:
    for axis in emulator.controller.state.axes:
        axis.stop(ABORT_INPUT, at_once=True)
        if axis.parameters["OE"] in (1, 3):
            axis.servo_off(ABORT_INPUT)
    if not emulator.controller.state.programs_outlive_abort:
        emulator.controller.engine.halt()


def _emergency_stop(emulator: Emulator) -> None:
    for axis in emulator.controller.state.axes:
        axis.stop_code = AMPLIFIER_FAULT
        axis.servo_off(AMPLIFIER_FAULT)


def _input(emulator: Emulator, number: int, level: int) -> None:
    emulator.controller.state.set_input(number, level)


def _analog(emulator: Emulator, number: int, volts: float) -> None:
    if not 1 <= number <= ANALOG_INPUTS:
        raise ValueError(f"analog: no analog input {number}")
    emulator.controller.state.analog_inputs[number - 1] = volts


def _sample_time(emulator: Emulator, scale: float) -> None:
    state = emulator.controller.state
    state.set_time_setting(state.time_setting, scale)


def _step(emulator: Emulator, samples: int) -> None:
    if not isinstance(emulator.clock, SteppedClock):
        raise ValueError("the clock runs by itself; start with --clock stepped")
    emulator.step(emulator.clock, samples)


def _clear(emulator: Emulator) -> None:
    emulator.faults.clear()
    for axis in emulator.controller.state.axes:
        axis.switches.forced.clear()
        axis.servo.frozen_counts = None
        axis.servo.disturbance_counts = 0
        axis.buffer.lose_next = 0
    _sample_time(emulator, 1.0)


_EVERY = {"handle": ALL}
_NONE: dict[str, Any] = {}

COMMANDS: dict[str, ControlCommand] = {
    "delay": ControlCommand(
        lambda emulator, handle, seconds: emulator.faults.delay(handle, seconds),
        {"seconds": _seconds, "handle": _handle},
        _EVERY,
    ),
    "split": ControlCommand(
        lambda emulator, handle: emulator.faults.split(handle), {"handle": _handle}, _EVERY
    ),
    **{
        kind: ControlCommand(
            lambda emulator, handle, replies, kind=kind: emulator.faults.damage(handle, kind, replies),
            {"replies": _count, "handle": _handle},
            _EVERY | {"replies": 1},
        )
        for kind in ("drop", "garble", "stale", "merge")
    },
    "refuse-pv": ControlCommand(
        lambda emulator, at, code: emulator.faults.refuse_segment(at, code),
        {"at": _count, "code": _count},
        {"code": 6},
    ),
    "half-open": ControlCommand(
        lambda emulator, handle: emulator.faults.half_open(handle), {"handle": _handle}, _EVERY
    ),
    "reset": ControlCommand(_reset, {"handle": _handle}, _EVERY),
    "power-cycle": ControlCommand(
        lambda emulator, seconds: emulator.power_cycle(seconds), {"seconds": _seconds}, {"seconds": 0.0}
    ),
    "skew": ControlCommand(_skew, {"axis": str, "segments": _count}, {"segments": 1}),
    "limit": ControlCommand(_limit, {"axis": str, "side": _side}, _NONE),
    "position-error": ControlCommand(_position_error, {"axis": str, "counts": int}, _NONE),
    "encoder": ControlCommand(_encoder, {"axis": str}, _NONE),
    "abort-input": ControlCommand(_abort_input, {}, _NONE),
    "e-stop": ControlCommand(_emergency_stop, {}, _NONE),
    "input": ControlCommand(_input, {"number": _count, "level": _count}, _NONE),
    "analog": ControlCommand(_analog, {"number": _count, "volts": float}, _NONE),
    "sample-time": ControlCommand(_sample_time, {"scale": _positive}, _NONE),
    "step": ControlCommand(_step, {"samples": _count}, _NONE),
    "clear": ControlCommand(_clear, {}, _NONE),
}
