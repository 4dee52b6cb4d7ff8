"""What the controller said while it moved: its clock and its encoders, poll by poll."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.machine.controller import BufferStatus
from ibfctl.machine.program import IntArray


@dataclass(frozen=True)
class Polls:
    """All polls of one motion.

    Attributes
    ----------
    time_samples : (n,) int64
        The controller's sample counter.
    host_s : (n,) float64
        Monotonic clock of the host, halfway between question and answer.
    position_counts : mapping of axis letter to (n,) int64
        Encoder positions.
    round_trip_s
        The longest round trip of all.
    unanswered_s
        How long after the last poll that was answered the last one was sent; it may have been a sign of life.
    open_samples
        The last sample counter that came with the gate reading open; 0 where none did.
    """

    time_samples: IntArray
    host_s: NDArray[np.float64]
    position_counts: dict[str, IntArray]
    round_trip_s: float
    unanswered_s: float
    open_samples: int


class PollLog:
    """Collects polls, in a few bytes each."""

    def __init__(self, letters: Sequence[str]) -> None:
        self._time, self._host = array("q"), array("d")
        self._positions = {letter: array("q") for letter in letters}
        self._round_trip_s = 0.0
        self._open_samples = 0
        self._sent_at = self._answered_from = 0.0

    def ask(self, asked_at: float) -> None:
        """Note that a poll is sent."""
        self._sent_at = asked_at

    def add(self, status: BufferStatus, asked_at: float, answered_at: float) -> None:
        """Keep one answer."""
        self._sent_at = self._answered_from = asked_at
        self._time.append(status.time_samples)
        if status.gate_open:
            self._open_samples = status.time_samples
        self._host.append((asked_at + answered_at) / 2)
        self._round_trip_s = max(self._round_trip_s, answered_at - asked_at)
        for letter, values in self._positions.items():
            values.append(status.position_counts[letter])

    def polls(self) -> Polls:
        """Return what was collected."""
        return Polls(
            np.array(self._time, dtype=np.int64),
            np.array(self._host, dtype=np.float64),
            {letter: np.array(values, dtype=np.int64) for letter, values in self._positions.items()},
            self._round_trip_s,
            self._sent_at - self._answered_from,
            self._open_samples,
        )
