"""Commanded motion as a function of time: what every motion mode must offer, and phased motion.

Positions are counts, velocities counts/s, accelerations counts/s^2, all doubles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Profile(Protocol):
    """Commanded motion of one axis, from the present sample on.

    `look` computes coming samples without consuming them, so that the axis can find an event among
    them (a limit, say) and `take` only the samples before it.
    """

    position_counts: float
    velocity_counts_s: float
    end_code: int | None
    """Stop code once the profile has ended, None while it runs."""

    @property
    def busy(self) -> bool:
        """Whether motion is being generated; False for a mode that waits for data."""

    def look(self, samples: int) -> FloatArray:
        """Positions of at most `samples` coming samples; fewer where the profile ends before."""

    def take(self, samples: int) -> None:
        """Consume samples that `look` has shown."""

    def abandon(self) -> None:
        """Give up before the end: what is queued for this profile is lost."""


class PhasedProfile:
    """Phases of constant acceleration, evaluated exactly at each sample.

    Parameters
    ----------
    position_counts, velocity_counts_s
        State at the start.
    phases
        Duration in s and acceleration in counts/s^2 of each phase; the last may last for ever.
    end_counts
        Position at the end of the last phase; the nearest count to its own end if None.
    sample_period_s
        Length of a sample.
    end_code
        Stop code to leave with.
    """

    def __init__(
        self,
        position_counts: float,
        velocity_counts_s: float,
        phases: Sequence[tuple[float, float]],
        *,
        sample_period_s: float,
        end_code: int,
        end_counts: float | None = None,
    ) -> None:
        self.position_counts = position_counts
        self.velocity_counts_s = velocity_counts_s
        self.end_code: int | None = None
        self._leave_with = end_code
        self._period_s = sample_period_s
        self._taken = 0
        starts: list[tuple[float, float, float, float]] = []
        time_s, position, velocity = 0.0, position_counts, velocity_counts_s
        for duration_s, acceleration in phases:
            starts.append((time_s, position, velocity, acceleration))
            if math.isinf(duration_s):
                time_s = math.inf
                break
            position += (velocity + 0.5 * acceleration * duration_s) * duration_s
            velocity += acceleration * duration_s
            time_s += duration_s
        self._starts = np.array(starts or [(0.0, position, velocity, 0.0)])
        self._end_counts = float(round(position)) if end_counts is None else end_counts
        # A phase that ends on a sample up to rounding ends there, not one sample later.
        self._total = math.inf if math.isinf(time_s) else math.ceil(time_s / sample_period_s - 1e-6)
        if self._total <= 0:
            self._end()

    @property
    def busy(self) -> bool:
        """Always true: a move runs until it has ended."""
        return True

    @property
    def slewing(self) -> bool:
        """Whether the present phase has no acceleration."""
        return bool(self._phase(self._taken * self._period_s)[3] == 0.0)

    @property
    def braking(self) -> bool:
        """Whether the last phase is at work and slows the axis down."""
        phase = self._phase(self._taken * self._period_s)
        return bool(phase[0] == self._starts[-1, 0] and phase[3] * self.velocity_counts_s < 0.0)

    def look(self, samples: int) -> FloatArray:
        """Positions of the coming samples."""
        count = int(min(samples, self._total - self._taken))
        positions, _ = self._evaluate(np.arange(self._taken + 1, self._taken + count + 1))
        if self._taken + count == self._total and count:
            positions[-1] = self._end_counts
        return positions

    def take(self, samples: int) -> None:
        """Consume samples; at the last one the axis stands at the end position."""
        self._taken += samples
        if self._taken >= self._total:
            self._end()
        elif samples:
            positions, velocities = self._evaluate(np.array([self._taken]))
            self.position_counts = float(positions[0])
            self.velocity_counts_s = float(velocities[0])

    def abandon(self) -> None:
        """Nothing is queued for a phased move."""

    def _end(self) -> None:
        self.position_counts = self._end_counts
        self.velocity_counts_s = 0.0
        self.end_code = self._leave_with

    def _evaluate(self, sample: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        time_s = sample * self._period_s
        phase = self._phase(time_s)
        since_s = time_s - phase[:, 0]
        velocity = phase[:, 2] + phase[:, 3] * since_s
        return phase[:, 1] + 0.5 * (phase[:, 2] + velocity) * since_s, velocity

    def _phase(self, time_s: NDArray[np.floating] | float) -> FloatArray:
        """Rows of start time, position, velocity and acceleration of the phase at each time."""
        rows: FloatArray = self._starts[np.searchsorted(self._starts[:, 0], time_s, side="right") - 1]
        return rows
