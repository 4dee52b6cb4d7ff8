"""Program memory: lines, the statements on them, and labels."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.errors import CommandError

LONGEST_LINE = 80
MOST_LINES = 2000
MOST_LABELS = 510

_LABEL = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,7}")


class Statement(NamedTuple):
    """One statement and the number of its line."""

    line: int
    text: str


class Program:
    """Lines of a program, never changed once made.

    Attributes
    ----------
    statements
        All statements in order; a thread's place is an index into them.
    labels
        Line of each label.

    Raises
    ------
    CommandError
        60 for a line that is too long or for too many lines, 11, 61 and 62 for bad, duplicate or too many labels.
    """

    def __init__(self, lines: Sequence[str] = ()) -> None:
        if len(lines) > MOST_LINES or any(len(line) > LONGEST_LINE for line in lines):
            raise CommandError(errors.DOWNLOAD)
        self.lines = tuple(lines)
        self.statements: list[Statement] = []
        self.labels: dict[str, int] = {}
        self._first_of_line: list[int] = []
        for number, line in enumerate(lines):
            self._first_of_line.append(len(self.statements))
            statements = _statements(line)
            if statements and statements[0].startswith("#"):
                label = statements.pop(0)[1:].strip()
                if not _LABEL.fullmatch(label):
                    raise CommandError(errors.BAD_LINE)
                if label in self.labels:
                    raise CommandError(errors.DUPLICATE_LABEL)
                self.labels[label] = number
            self.statements += [Statement(number, text) for text in statements]
        if len(self.labels) > MOST_LABELS:
            raise CommandError(errors.TOO_MANY_LABELS)

    def at_line(self, line: int) -> int:
        """Return the place of the first statement on or behind a line.

        Raises
        ------
        CommandError
            11 if there is no such line.
        """
        if not 0 <= line < len(self.lines):
            raise CommandError(errors.BAD_LINE)
        return self._first_of_line[line]

    def at_label(self, label: str) -> int:
        """Return the place of the first statement behind a label.

        Raises
        ------
        CommandError
            10 if there is no such label.
        """
        if label not in self.labels:
            raise CommandError(errors.UNDEFINED_LABEL)
        return self._first_of_line[self.labels[label]]

    def line_of(self, place: int) -> int:
        """Return the line of a place, that of the last statement behind the end."""
        if not self.statements:
            return 0
        return self.statements[min(place, len(self.statements) - 1)].line


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
