"""What the axes are asked: numbers by operand, one round trip each."""

from __future__ import annotations

from collections.abc import Iterable

from ibfctl.machine.controller import AxisStatus
from ibfctl_drivers.galil.codec import message_of, parse_integers
from ibfctl_drivers.galil.link import Link, RejectedError


class AxisReader:
    """Asks over one link.

    Parameters
    ----------
    link
        Handle for questions.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def numbers(self, operands: Iterable[str]) -> list[int]:
        """Return the whole numbers that `operands` stand for."""
        names = list(operands)
        question = message_of(names)
        return parse_integers(self._link.ask(question), len(names), question)

    def variable(self, name: str) -> int | None:
        """Return the value of a variable on the controller; None where there is none of that name."""
        try:
            return self.numbers([name])[0]
        except RejectedError:
            return None

    def status(self, letter: str) -> AxisStatus:
        """Return the full status of an axis."""
        values = self.numbers(f"{operand}{letter}" for operand in ("_TP", "_TE", "_SC", "_BG", "_MO"))
        position, error, stop_code, moving, off = values
        return AxisStatus(position, error, stop_code, bool(moving), not off)
