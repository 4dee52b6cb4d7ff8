"""What can go wrong between the controller and its clients."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

Damage = Literal["drop", "garble", "stale", "merge"]

ALL = "*"
_GARBLE = 0x55


@dataclass
class _OneHandle:
    """State of the faults of one handle."""

    delay_s: float = 0.0
    split: bool = False
    deaf: bool = False
    damage: dict[Damage, int] = field(default_factory=dict)
    """How many replies are still to be damaged in each way."""
    held: str = ""


class ReplyFaults:
    """Damages replies on their way to a client; without faults a batch of replies goes out in one piece.

    Handles are named by letter; faults set for `*` hold for every handle.
    """

    def __init__(self) -> None:
        self._of: dict[str, _OneHandle] = {}
        self._last: dict[str, str] = {}
        self._late: dict[str, deque[bytes]] = {}
        self._timers: set[asyncio.TimerHandle] = set()
        self._refuse_at: int | None = None
        self._refuse_code = 0
        self._segments_seen = 0

    def clear(self) -> None:
        """End all faults; delayed replies are lost."""
        for timer in self._timers:
            timer.cancel()
        self._timers.clear()
        self._late.clear()
        self._of.clear()
        self._refuse_at = None

    def delay(self, letter: str, seconds: float) -> None:
        """Send every reply `seconds` (of wall-clock time) late."""
        self._get(letter).delay_s = seconds

    def split(self, letter: str) -> None:
        """Send every reply byte by byte."""
        self._get(letter).split = True

    def half_open(self, letter: str) -> None:
        """Read nothing more and answer nothing more, without closing."""
        self._get(letter).deaf = True

    def damage(self, letter: str, kind: Damage, replies: int) -> None:
        """Damage the next `replies` replies: dropped, garbled, replaced by the one before, or held back."""
        self._get(letter).damage[kind] = replies

    def refuse_segment(self, number: int, code: int) -> None:
        """Answer `?` to the `number`-th `PV` from now on."""
        self._refuse_at, self._refuse_code, self._segments_seen = number, code, 0

    def deaf(self, letter: str) -> bool:
        """Whether the connection on a handle is half open."""
        return any(one.deaf for one in self._at(letter))

    def refusal(self, command: str) -> int | None:
        """Error code with which a command is refused by a fault, None if it is not."""
        if self._refuse_at is None or not command.startswith("PV"):
            return None
        self._segments_seen += 1
        if self._segments_seen != self._refuse_at:
            return None
        self._refuse_at = None
        return self._refuse_code

    def deliver(self, letter: str, replies: list[str], send: Callable[[bytes], None]) -> None:
        """Send a batch of replies to a client, as the faults of its handle have it."""
        faults = self._at(letter)
        before, self._last[letter] = [self._last.get(letter, ""), *replies[:-1]], replies[-1]
        pairs = list(zip(before, replies, strict=True))
        for one in faults:
            pairs = [(last, text) for last, reply in pairs for text in _damaged(one, last, reply)]
        if not pairs:
            return
        data = "".join(text for _, text in pairs).encode("latin-1")
        pieces = [bytes([byte]) for byte in data] if any(one.split for one in faults) else [data]
        delay_s = max((one.delay_s for one in faults), default=0.0)
        for piece in pieces:
            if delay_s:
                self._later(letter, delay_s, piece, send)
            else:
                send(piece)

    def _later(self, letter: str, delay_s: float, data: bytes, send: Callable[[bytes], None]) -> None:
        """Send later; the queue keeps the order where two timers fall together."""
        queue = self._late.setdefault(letter, deque())
        queue.append(data)

        def act() -> None:
            self._timers.discard(timer)
            send(queue.popleft())

        timer = asyncio.get_running_loop().call_later(delay_s, act)
        self._timers.add(timer)

    def _get(self, letter: str) -> _OneHandle:
        return self._of.setdefault(letter, _OneHandle())

    def _at(self, letter: str) -> list[_OneHandle]:
        return [self._of[key] for key in (ALL, letter) if key in self._of] if self._of else []


def _damaged(one: _OneHandle, before: str, reply: str) -> list[str]:
    """What goes out for one reply, given the reply before it."""
    if _due(one, "drop"):
        return []
    if _due(one, "garble"):
        reply = "".join(chr(ord(character) ^ _GARBLE) for character in reply)
    if _due(one, "stale"):
        reply = before or reply
    if _due(one, "merge"):
        one.held += reply
        return []
    held, one.held = one.held, ""
    return [held + reply]


def _due(one: _OneHandle, kind: Damage) -> bool:
    left = one.damage.get(kind, 0)
    one.damage[kind] = max(0, left - 1)
    return left > 0
