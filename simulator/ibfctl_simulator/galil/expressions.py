"""Galil expressions: strictly left to right, parentheses apart, in fixed point of 1/65536.

A text is parsed once into a function of what it names and then kept: programs evaluate the same
conditions over and over.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import lru_cache
from typing import Protocol

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.errors import CommandError

FRACTION = 65536
LARGEST = 2_147_483_647.9999
DEEPEST = 32

_TOKEN = re.compile(
    r"\s*(?:(?P<number>\$[0-9A-F]+(?:\.[0-9A-F]+)?|\d+\.?\d*|\.\d+)"
    r"|(?P<function>@[A-Z]+\[)"
    r"|(?P<operand>_[A-Z][A-Za-z0-9]*)"
    r"|(?P<name>[A-Za-z][A-Za-z0-9_]*)"
    r"|(?P<sign><=|>=|<>|[-+*/%&|()<>=\]\[]))"
)


class Values(Protocol):
    """Where an expression finds what it names; each method raises `CommandError` for what is unknown."""

    def operand(self, name: str) -> float:
        """Value of `_XXn`, given without the underscore, or of a keyword such as `TIME`."""

    def variable(self, name: str) -> float:
        """Value of a user variable."""

    def function(self, name: str, argument: float) -> float:
        """Value of `@NAME[argument]`."""

    def element(self, name: str, index: float) -> float:
        """Value of an array element."""


def fixed(value: float) -> float:
    """Return `value` as the controller's fixed point number.

    Raises
    ------
    CommandError
        6 if it does not fit.
    """
    if not -LARGEST - 1.0 <= value <= LARGEST:
        raise CommandError(errors.OUT_OF_RANGE)
    return math.trunc(value * FRACTION) / FRACTION


def evaluate(text: str, values: Values) -> float:
    """Evaluate an expression.

    Raises
    ------
    CommandError
        4 for a malformed expression, 9 for an unknown variable, 57 for an unknown function, 58 for an
        unknown operand, 59 for unbalanced parentheses, 6 for a result that does not fit.
    """
    return _compiled(text)(values)


Evaluation = Callable[[Values], float]


@lru_cache(maxsize=4096)
def _compiled(text: str) -> Evaluation:
    parser = _Parser(_tokens(text))
    evaluation = parser.expression(0)
    parser.expect_end()
    return evaluation


def _tokens(text: str) -> list[tuple[str, str]]:
    tokens: list[tuple[str, str]] = []
    position, text = 0, text.rstrip()
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None or match.lastgroup is None:
            raise CommandError(errors.OPERAND)
        tokens.append((match.lastgroup, match[match.lastgroup]))
        position = match.end()
    return tokens


class _Parser:
    """Turns tokens into a function of what they name."""

    def __init__(self, tokens: list[tuple[str, str]]) -> None:
        self._tokens = tokens
        self._next = 0

    def expect_end(self) -> None:
        if self._next < len(self._tokens):
            bracket = self._tokens[self._next][1] in ("(", ")")
            raise CommandError(errors.BAD_PARENTHESES if bracket else errors.OPERAND)

    def expression(self, depth: int) -> Evaluation:
        if depth > DEEPEST:
            raise CommandError(errors.BAD_PARENTHESES)
        evaluation = self._factor(depth)
        while self._next < len(self._tokens) and self._tokens[self._next][1] in _OPERATORS:
            operator = _OPERATORS[self._take()[1]]
            evaluation = _joined(operator, evaluation, self._factor(depth))
        return evaluation

    def _take(self) -> tuple[str, str]:
        if self._next >= len(self._tokens):
            raise CommandError(errors.OPERAND)
        self._next += 1
        return self._tokens[self._next - 1]

    def _closing(self, bracket: str) -> None:
        if self._next >= len(self._tokens) or self._take()[1] != bracket:
            raise CommandError(errors.BAD_PARENTHESES)

    def _factor(self, depth: int) -> Evaluation:
        if depth > DEEPEST:
            raise CommandError(errors.OPERAND)
        kind, text = self._take()
        if kind == "number":
            number = fixed(_number(text))
            return lambda values: number
        if kind == "operand":
            return lambda values: values.operand(text[1:])
        if kind == "function":
            argument = self.expression(depth + 1)
            self._closing("]")
            return lambda values: fixed(values.function(text[1:-1], argument(values)))
        if kind == "name":
            return self._named(text, depth)
        if text == "-":
            factor = self._factor(depth + 1)
            return lambda values: fixed(-factor(values))
        if text == "+":
            return self._factor(depth + 1)
        if text == "(":
            inner = self.expression(depth + 1)
            self._closing(")")
            return inner
        raise CommandError(errors.BAD_PARENTHESES if text == ")" else errors.OPERAND)

    def _named(self, name: str, depth: int) -> Evaluation:
        if self._next < len(self._tokens) and self._tokens[self._next][1] == "[":
            self._next += 1
            index = self.expression(depth + 1)
            self._closing("]")
            return lambda values: values.element(name, index(values))
        if name == "TIME":
            return lambda values: values.operand(name)
        return lambda values: values.variable(name)


def _joined(operator: Callable[[float, float], float], left: Evaluation, right: Evaluation) -> Evaluation:
    return lambda values: operator(left(values), right(values))


def _number(text: str) -> float:
    if not text.startswith("$"):
        return float(text)
    whole, _, fraction = text[1:].partition(".")
    number = int(whole, 16)
    signed = number - (1 << 32) if number >= 1 << 31 and number < 1 << 32 else number
    return signed + (int(fraction, 16) / 16 ** len(fraction) if fraction else 0.0)


def _divide(left: float, right: float) -> float:
    if right == 0.0:
        raise CommandError(errors.OUT_OF_RANGE)
    return fixed(left / right)


def _remainder(left: float, right: float) -> float:
    if right == 0.0:
        raise CommandError(errors.OUT_OF_RANGE)
    return fixed(math.fmod(left, right))


_OPERATORS: dict[str, Callable[[float, float], float]] = {
    "+": lambda a, b: fixed(a + b),
    "-": lambda a, b: fixed(a - b),
    "*": lambda a, b: fixed(a * b),
    "/": _divide,
    "%": _remainder,
    "&": lambda a, b: float(int(a) & int(b)),
    "|": lambda a, b: float(int(a) | int(b)),
    "<": lambda a, b: float(a < b),
    ">": lambda a, b: float(a > b),
    "=": lambda a, b: float(a == b),
    "<=": lambda a, b: float(a <= b),
    ">=": lambda a, b: float(a >= b),
    "<>": lambda a, b: float(a != b),
}
