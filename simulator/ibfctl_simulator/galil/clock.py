"""Simulated time: real, scaled or stepped by hand."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Tells the simulated time."""

    def now_s(self) -> float:
        """Return the simulated time since the start in s; never decreases."""


class ScaledClock:
    """Runs `speed` times as fast as the wall clock; 1 is real time.

    Raises
    ------
    ValueError
        If `speed` is not positive and finite.
    """

    def __init__(self, speed: float = 1.0) -> None:
        if not 0.0 < speed < float("inf"):
            raise ValueError(f"speed: {speed} is not a positive number")
        self.speed = speed
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Return the simulated time since the clock was made, in s."""
        return (time.monotonic() - self._start_s) * self.speed

    def slip(self, seconds: float) -> None:
        """Go back by `seconds` of simulated time that nobody could keep up with."""
        self._start_s += seconds / self.speed


class SteppedClock:
    """Stands still until it is stepped, so that a run is the same every time."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now_s(self) -> float:
        """Return the sum of all steps in s."""
        return self._now_s

    def step(self, seconds: float) -> None:
        """Let `seconds` pass."""
        if seconds < 0.0:
            raise ValueError(f"step of {seconds} s: time cannot run backwards")
        self._now_s += seconds
