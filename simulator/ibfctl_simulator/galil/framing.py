"""From a stream of bytes to single commands: CR or `;` ends one, LF is ignored."""

from __future__ import annotations

from collections import deque


class Framing:
    """Cuts what one client sends into commands.

    A client may end its commands with `;` alone, so a part is handed out as soon as its `;` is there.
    The length of a line counts all its parts since the last CR; where everything received so far ended
    in `;`, nothing is left in the controller's line buffer and counting starts anew.
    """

    def __init__(self, line_characters: int) -> None:
        self._limit = line_characters
        self._ready: deque[str | None] = deque()
        self._buffer = ""
        self._line_length = 0
        self._skipping = False

    def push(self, data: bytes) -> None:
        """Add received bytes."""
        lines = (self._buffer + data.decode("latin-1").replace("\n", "")).split("\r")
        for line in lines[:-1]:
            self._line(line)
        self._rest(lines[-1])

    def next_command(self) -> str | None:
        """Return the next command, None for an over-long line; raises `LookupError` if there is none."""
        if not self._ready:
            raise LookupError
        return self._ready.popleft()

    def _line(self, line: str) -> None:
        if self._skipping:
            self._skipping = False
        elif self._line_length + len(line) > self._limit:
            self._ready.append(None)
        else:
            self._ready.extend(part.strip() for part in line.split(";"))
        self._line_length = 0

    def _rest(self, rest: str) -> None:
        """Keep an unfinished line, but hand out the parts that are already ended by `;`."""
        self._buffer = rest
        if self._skipping:
            self._buffer, self._skipping = "", not rest.endswith(";")
        elif self._line_length + len(rest) > self._limit:
            self._ready.append(None)
            self._buffer, self._skipping = "", True
        elif ";" in rest:
            parts = rest.split(";")
            self._ready.extend(part.strip() for part in parts[:-1])
            self._buffer = parts[-1]
            self._line_length += len(rest) - len(parts[-1])
            if not parts[-1]:
                self._line_length = 0
