"""Straight lines between two speeds under a limited jerk: up to seven phases, at rest in acceleration at both ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_BISECTIONS = 60


@dataclass(frozen=True)
class Lines:
    """Straight lines, (n,) each.

    Attributes
    ----------
    length_mm, v_max_mm_s, a_max_mm_s2, j_max_mm_s3
        Length and the limits along each.
    """

    length_mm: FloatArray
    v_max_mm_s: FloatArray
    a_max_mm_s2: FloatArray
    j_max_mm_s3: FloatArray

    def reach(self, speed_mm_s: FloatArray) -> FloatArray:
        """Highest speed (n,) at the other end of each line for a speed at this one; within `v_max_mm_s`.

        The way of a change by d is (2 v + d) / 2 times its time: 2 sqrt(d / j), or d / a + a / j from d = a² / j on.
        """
        v, way, a, j = speed_mm_s, self.length_mm, self.a_max_mm_s2, self.j_max_mm_s3
        # Without a phase of constant acceleration, with x = sqrt(d / j):  j x³ + 2 v x = way.
        third, half = 2 * v / (3 * j), way / (2 * j)
        larger = np.cbrt(half + np.sqrt(half**2 + third**3))
        x = np.divide(
            2 * half, larger**2 + third + np.divide(third, larger, out=np.zeros_like(v), where=larger > 0) ** 2,
            out=np.zeros_like(v), where=larger > 0,
        )  # fmt: skip
        # With one:  d² + (2 v + a² / j) d + 2 v a² / j = 2 a way.
        middle = v + 0.5 * a**2 / j
        rest = 2 * a * way - 2 * v * a**2 / j
        with_plateau = rest / (middle + np.sqrt(np.maximum(middle**2 + rest, 0.0)))
        change = np.where(j * x**2 <= a**2 / j, j * x**2, with_plateau)
        return np.minimum(v + change, self.v_max_mm_s)

    def top_mm_s(self, first_mm_s: FloatArray, last_mm_s: FloatArray) -> FloatArray:
        """Highest speed (n,) on each line between the speeds at its ends."""
        low, high = np.maximum(first_mm_s, last_mm_s), np.maximum(self.v_max_mm_s, np.maximum(first_mm_s, last_mm_s))
        fits = self._way(first_mm_s, high) + self._way(high, last_mm_s) <= self.length_mm
        low = np.where(fits, high, low)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            fits = self._way(first_mm_s, middle) + self._way(middle, last_mm_s) <= self.length_mm
            low, high = np.where(fits, middle, low), np.where(fits, high, middle)
        return low

    def time_s(self, first_mm_s: FloatArray, last_mm_s: FloatArray) -> FloatArray:
        """Shortest time (n,) on each line between the speeds at its ends."""
        return np.asarray(self.phases(first_mm_s, last_mm_s)[0].sum(axis=0))

    def phases(self, first_mm_s: FloatArray, last_mm_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Durations and jerks, (7, n) each: speeding up in three, steady in one, slowing down in three."""
        top = self.top_mm_s(first_mm_s, last_mm_s)
        up, down = self._ramp_s(top - first_mm_s), self._ramp_s(top - last_mm_s)
        rest_mm = np.maximum(self.length_mm - self._way(first_mm_s, top) - self._way(top, last_mm_s), 0.0)
        steady_s = np.divide(rest_mm, top, out=np.zeros_like(top), where=top > 0)
        time_s = np.stack([up[0], up[1], up[0], steady_s, down[0], down[1], down[0]])
        return time_s, np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])[:, None] * self.j_max_mm_s3

    def _ramp_s(self, change_mm_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Times with jerk (each of two) and with constant acceleration for a change of speed, (n,) each."""
        change = np.maximum(change_mm_s, 0.0)
        full = self.a_max_mm_s2 / self.j_max_mm_s3
        jerking = np.minimum(np.sqrt(change / self.j_max_mm_s3), full)
        return jerking, np.maximum(change / self.a_max_mm_s2 - full, 0.0)

    def _way(self, first_mm_s: FloatArray, last_mm_s: FloatArray) -> FloatArray:
        jerking, steady = self._ramp_s(np.abs(last_mm_s - first_mm_s))
        return np.asarray(0.5 * (first_mm_s + last_mm_s) * (2 * jerking + steady))

    def __getitem__(self, chosen: slice) -> Lines:
        """Some of the lines."""
        return Lines(
            self.length_mm[chosen], self.v_max_mm_s[chosen], self.a_max_mm_s2[chosen], self.j_max_mm_s3[chosen]
        )
