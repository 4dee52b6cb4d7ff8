"""What went over the wire, gathered for the journal: every command with its reply, batches of segments as digests."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

GATHER_S = 1.0
MOST_EXCHANGES = 256


class WireRecorder:
    """Observer of a driver (`ibfctl.machine.controller.Observer`) that records in portions.

    Parameters
    ----------
    record
        Takes a kind and its data: `JournalWriter.record`.
    """

    def __init__(self, record: Callable[[str, Mapping[str, Any]], None]) -> None:
        self._record = record
        self._lock = threading.Lock()
        self._exchanges: list[tuple[str, str, str, float]] = []
        self._due = 0.0

    def __call__(self, handle: str, sent: str, reply: str, at_s: float) -> None:
        """Note one exchange."""
        with self._lock:
            if not self._exchanges:
                self._due = time.monotonic() + GATHER_S
            self._exchanges.append((handle, sent, reply, at_s))
            if len(self._exchanges) < MOST_EXCHANGES and time.monotonic() < self._due:
                return
        self.flush()

    def flush(self) -> None:
        """Record what was gathered."""
        with self._lock:
            exchanges, self._exchanges = self._exchanges, []
            if exchanges:
                self._record("wire", {"exchanges": exchanges})
