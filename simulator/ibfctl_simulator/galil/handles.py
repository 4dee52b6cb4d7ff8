"""The eight Ethernet handles A to H that all clients share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

LETTERS = "ABCDEFGH"


@dataclass(frozen=True)
class Handle:
    """One open connection: its letter, the client's address, and how to reset it."""

    letter: str
    address: str
    port: int
    reset: Callable[[], None]


class Handles:
    """Which handles are in use."""

    def __init__(self) -> None:
        self._open: dict[str, Handle] = {}

    def open(self, address: str, port: int, reset: Callable[[], None]) -> Handle | None:
        """Give the first free handle to a client; None if all are in use."""
        for letter in LETTERS:
            if letter not in self._open:
                self._open[letter] = Handle(letter, address, port, reset)
                return self._open[letter]
        return None

    def release(self, handle: Handle) -> None:
        """Free a handle whose connection is gone."""
        if self._open.get(handle.letter) is handle:
            del self._open[handle.letter]

    def get(self, letter: str) -> Handle | None:
        """Return the handle with that letter if it is in use."""
        return self._open.get(letter)

    def all(self) -> list[Handle]:
        """Return the handles in use, in order of their letters."""
        return [self._open[letter] for letter in LETTERS if letter in self._open]
