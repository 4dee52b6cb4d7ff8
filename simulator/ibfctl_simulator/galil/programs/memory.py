"""Program memory: lines, the statements on them, and labels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.errors import CommandError

LONGEST_LINE = 80
MOST_LINES = 2000
MOST_LABELS = 510


class Place(NamedTuple):
    """A statement: its line, and its position among the statements of that line."""

    line: int
    column: int


class Program:
    """Lines of a program, never changed once made.

    Raises
    ------
    CommandError
        60 for a line that is too long or for too many lines, 61 and 62 for duplicate or too many labels.
    """

    def __init__(self, lines: Sequence[str] = ()) -> None:
        if len(lines) > MOST_LINES or any(len(line) > LONGEST_LINE for line in lines):
            raise CommandError(errors.DOWNLOAD)
        self.lines = tuple(lines)
        self._statements = [_statements(line) for line in lines]
        self.labels: dict[str, int] = {}
        for number, statements in enumerate(self._statements):
            if statements and statements[0].startswith("#"):
                label = statements[0][1:].strip()
                if label in self.labels:
                    raise CommandError(errors.DUPLICATE_LABEL)
                self.labels[label] = number
        if len(self.labels) > MOST_LABELS:
            raise CommandError(errors.TOO_MANY_LABELS)

    def statement(self, place: Place) -> str | None:
        """Text of a statement; None behind the last one of a line."""
        statements = self._statements[place.line]
        return statements[place.column] if place.column < len(statements) else None

    def following(self, place: Place) -> Place | None:
        """The first place at or after `place` that holds a statement; None at the end of the program."""
        line, column = place
        while line < len(self.lines):
            if column < len(self._statements[line]):
                return Place(line, column)
            line, column = line + 1, 0
        return None

    def destination(self, label: str) -> Place:
        """Place of a label.

        Raises
        ------
        CommandError
            10 if there is no such label.
        """
        if label not in self.labels:
            raise CommandError(errors.UNDEFINED_LABEL)
        return Place(self.labels[label], 0)


def split_statements(text: str, separator: str = ";") -> list[str]:
    """Split at a separator that is not inside quotes."""
    parts, quoted = [""], False
    for character in text:
        if character == '"':
            quoted = not quoted
        if character == separator and not quoted:
            parts.append("")
        else:
            parts[-1] += character
    return parts


def _statements(line: str) -> list[str]:
    """Statements of a line; a quote sign begins a comment."""
    code = split_statements(line, "'")[0]
    return [part.strip() for part in split_statements(code) if part.strip()]
