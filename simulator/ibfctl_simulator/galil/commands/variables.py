"""User variables and arrays."""

from __future__ import annotations

import re

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.arguments import integer
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.operands import element_index

MOST_VARIABLES = 510
MOST_ELEMENTS = 24000
NAME = r"[A-Za-z][A-Za-z0-9_]{0,7}"

_NAME = re.compile(NAME)
_TARGET = re.compile(rf"\s*({NAME})\s*(?:\[(.+)\])?\s*")
_ARRAY = re.compile(rf"\s*({NAME})\[(.+)\]\s*")


def target(text: str) -> tuple[str, str | None] | None:
    """Name and index text of what stands before a `=`; None if it is no variable."""
    match = _TARGET.fullmatch(text)
    return None if match is None else (match[1], match[2])


def assign(request: Request, where: tuple[str, str | None]) -> str | None:
    """`name=expression`, `name[i]=expression`, `name=?`."""
    name, index = where
    state = request.state
    if request.text == "?":
        value = request.values.variable(name) if index is None else request.values.element(name, request.value(index))
        return f"{value:.4f}"
    value = request.value(request.text)
    if index is not None:
        elements = state.arrays.get(name)
        if elements is None:
            raise CommandError(errors.BAD_FUNCTION)
        elements[element_index(elements, request.value(index))] = value
        return None
    if name not in state.variables and len(state.variables) >= MOST_VARIABLES:
        raise CommandError(errors.TOO_MANY_VARIABLES)
    state.variables[name] = value
    return None


def dimension(request: Request) -> None:
    """`DM name[n],...`: make arrays, filled with zero."""
    for item in request.text.split(","):
        match = _ARRAY.fullmatch(item)
        if match is None:
            raise CommandError(errors.BAD_FUNCTION)
        arrays = request.state.arrays
        used = sum(len(elements) for name, elements in arrays.items() if name != match[1])
        size = integer(request.value(match[2]), 1, MOST_ELEMENTS)
        if used + size > MOST_ELEMENTS:
            raise CommandError(errors.ARRAYS_FULL)
        arrays[match[1]] = [0.0] * size


def forget(request: Request) -> None:
    """`DA name,name[]`, `DA *`, `DA *[]`: forget variables and arrays."""
    for item in request.text.split(","):
        name, is_array = item.strip().removesuffix("[]"), item.strip().endswith("[]")
        if name == "*":
            (request.state.arrays if is_array else request.state.variables).clear()
        elif is_array:
            request.state.arrays.pop(name, None)
        elif _NAME.fullmatch(name):
            request.state.variables.pop(name, None)
        else:
            raise CommandError(errors.UNKNOWN_VARIABLE)


def list_variables(request: Request) -> str:
    """`LV`: all variables."""
    return "\r\n".join(f"{name}= {value:.4f}" for name, value in sorted(request.state.variables.items()))


def list_arrays(request: Request) -> str:
    """`LA`: all arrays with their sizes."""
    return "\r\n".join(f"{name}[{len(elements)}]" for name, elements in sorted(request.state.arrays.items()))


TABLE: dict[str, Handler] = {
    "DM": dimension,
    "DA": forget,
    "LV": list_variables,
    "LA": list_arrays,
}
