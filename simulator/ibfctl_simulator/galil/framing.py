"""From a stream of bytes to single commands: CR or `;` ends one, LF is ignored."""

from __future__ import annotations

from collections import deque

END_OF_PROGRAM = "\\"


class Framing:
    """Cuts what one client sends into commands, or into the lines of a program while it downloads one.

    A client may end its commands with `;` alone, so a part is handed out as soon as its `;` is there.
    The length of a line counts all its parts since the last CR; where everything received so far ended
    in `;`, nothing is left in the controller's line buffer and counting starts anew.
    """

    def __init__(self, line_characters: int) -> None:
        self._limit = line_characters
        self._parts: deque[str | None] = deque()
        self._buffer = ""
        self._start = 0
        self._line_length = 0
        self._skipping = False
        self._swallow_cr = False

    @property
    def unread_characters(self) -> int:
        """How much has been received and not been handed out."""
        return len(self._buffer) - self._start

    def push(self, data: bytes) -> None:
        """Add received bytes."""
        self._buffer = self._buffer[self._start :] + data.decode("latin-1").replace("\n", "")
        self._start = 0

    def next_command(self) -> str | None:
        """Return the next command, None for an over-long line; raises `LookupError` if there is none."""
        while not self._parts:
            line = self._take_line()
            if line is None:
                self._hand_out_ended_parts()
                if not self._parts:
                    raise LookupError
            else:
                self._hand_out_line(line)
        return self._parts.popleft()

    def drop_line(self) -> None:
        """Forget the commands that are left on the present line."""
        self._parts.clear()

    def next_program_line(self) -> tuple[str, bool]:
        """Return the next line of a program, and whether it is the end; raises `LookupError` if there is none."""
        end = self._buffer.find(END_OF_PROGRAM, self._start)
        carriage_return = self._buffer.find("\r", self._start)
        if end >= 0 and (carriage_return < 0 or end < carriage_return):
            line = self._buffer[self._start : end]
            self._start = end + 1
            # Some clients end the backslash with a CR; it is no command of its own.
            self._swallow_cr = True
            return line, True
        taken = self._take_line()
        if taken is None:
            rest = self._buffer[self._start :]
            if len(rest) <= self._limit:
                raise LookupError
            # Longer than any line already: hand it out, so that nobody can fill the memory with it.
            taken, self._buffer, self._start = rest, "", 0
        return taken, False

    def _take_line(self) -> str | None:
        if self._swallow_cr and self._start < len(self._buffer):
            self._start += self._buffer[self._start] == "\r"
            self._swallow_cr = False
        end = self._buffer.find("\r", self._start)
        if end < 0:
            return None
        line = self._buffer[self._start : end]
        self._start = end + 1
        return line

    def _hand_out_line(self, line: str) -> None:
        if self._skipping:
            self._skipping = False
        elif self._line_length + len(line) > self._limit:
            self._parts.append(None)
        else:
            self._parts.extend(part.strip() for part in line.split(";"))
        self._line_length = 0

    def _hand_out_ended_parts(self) -> None:
        """Keep an unfinished line, but hand out the parts that are already ended by `;`."""
        rest = self._buffer[self._start :]
        self._buffer, self._start = rest, 0
        if self._skipping:
            self._buffer, self._skipping = "", not rest.endswith(";")
        elif self._line_length + len(rest) > self._limit:
            self._parts.append(None)
            self._buffer, self._skipping = "", not rest.endswith(";")
            self._line_length = 0
        elif ";" in rest:
            *ended, self._buffer = rest.split(";")
            self._parts.extend(part.strip() for part in ended)
            self._line_length = self._line_length + len(rest) - len(self._buffer) if self._buffer else 0
