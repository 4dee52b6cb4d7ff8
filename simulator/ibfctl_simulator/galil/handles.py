"""The eight Ethernet handles A to H that all clients share, and where unasked text goes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

LETTERS = "ABCDEFGH"
SERIAL = "S"


@dataclass(frozen=True)
class Handle:
    """One open connection: its letter, the client's address, and how to send to it, close and reset it."""

    letter: str
    address: str
    port: int
    send: Callable[[bytes], None]
    close: Callable[[], None]
    reset: Callable[[], None]


class Handles:
    """Which handles are in use.

    Attributes
    ----------
    console
        Letter of the handle that unasked text goes to (`CF`); `S` for the serial port, where it is lost.
    marked
        Whether bit 7 of every byte of unasked text is set (`CW 1`).
    """

    def __init__(self) -> None:
        self._open: dict[str, Handle] = {}
        self.power_up()

    def power_up(self) -> None:
        """Send unasked text to the serial port, unmarked."""
        self.console = SERIAL
        self.marked = False

    def open(
        self,
        address: str,
        port: int,
        send: Callable[[bytes], None],
        close: Callable[[], None],
        reset: Callable[[], None],
    ) -> Handle | None:
        """Give the first free handle to a client; None if all are in use."""
        for letter in LETTERS:
            if letter not in self._open:
                self._open[letter] = Handle(letter, address, port, send, close, reset)
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

    def emit(self, text: str, letter: str | None = None) -> None:
        """Send text that no client asked for to a handle, by default the one that `CF` chose."""
        handle = self._open.get(letter or self.console)
        if handle is not None:
            data = text.encode("latin-1")
            handle.send(bytes(byte | 0x80 for byte in data) if self.marked else data)
