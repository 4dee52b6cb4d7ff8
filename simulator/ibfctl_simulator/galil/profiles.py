"""Commanded motion as a function of time: what every motion mode must offer, and the trapezoids.

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

    def look(self, samples: int) -> FloatArray:
        """Positions of at most `samples` coming samples; fewer where the profile ends before."""

    def take(self, samples: int) -> None:
        """Consume samples that `look` has shown."""


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

    def _end(self) -> None:
        self.position_counts = self._end_counts
        self.velocity_counts_s = 0.0
        self.end_code = self._leave_with

    def _evaluate(self, sample: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        time_s = sample * self._period_s
        phase = self._starts[np.searchsorted(self._starts[:, 0], time_s, side="right") - 1]
        since_s = time_s - phase[:, 0]
        velocity = phase[:, 2] + phase[:, 3] * since_s
        return phase[:, 1] + 0.5 * (phase[:, 2] + velocity) * since_s, velocity


def move_phases(
    distance: float, velocity: float, speed: float, acceleration: float, deceleration: float
) -> list[tuple[float, float]]:
    """Phases of a trapezoidal move over `distance` counts that ends at rest.

    Parameters
    ----------
    distance : signed distance to the target in counts
    velocity : signed velocity at the start in counts/s
    speed, acceleration, deceleration : positive limits

    Returns
    -------
    list of (duration in s, signed acceleration). A start velocity that leads away from the target,
    or too fast to stop in time, is first brought to rest.
    """
    stop_distance = velocity * abs(velocity) / (2.0 * deceleration)
    direction = 1.0 if distance >= 0 else -1.0
    if velocity * direction < 0 or abs(stop_distance) > abs(distance):
        rest = move_phases(distance - stop_distance, 0.0, speed, acceleration, deceleration)
        return [(abs(velocity) / deceleration, -math.copysign(deceleration, velocity)), *rest]
    start, length = abs(velocity), abs(distance)
    if length == 0.0:
        return []
    if start > speed:
        slowing = (start**2 - speed**2) / (2.0 * deceleration)
        cruise = length - slowing - speed**2 / (2.0 * deceleration)
        ramp = ((start - speed) / deceleration, -deceleration)
        peak = speed
    else:
        # Speed at which accelerating from `start` must turn into braking to stop at the target.
        work = 2.0 * acceleration * deceleration * length + deceleration * start**2
        peak = min(speed, math.sqrt(work / (acceleration + deceleration)))
        ramp = ((peak - start) / acceleration, acceleration)
        ramps = (peak**2 - start**2) / (2.0 * acceleration) + peak**2 / (2.0 * deceleration)
        cruise = max(0.0, length - ramps)
    phases = [ramp, (cruise / peak, 0.0), (peak / deceleration, -deceleration)]
    return [(duration, direction * rate) for duration, rate in phases if duration > 0.0]


def jog_phases(
    velocity: float, target: float, acceleration: float, deceleration: float
) -> list[tuple[float, float]]:
    """Phases from `velocity` to the jog velocity `target` (counts/s), held for ever after."""
    phases: list[tuple[float, float]] = []
    if velocity * target < 0.0:
        phases.append((abs(velocity) / deceleration, -math.copysign(deceleration, velocity)))
        velocity = 0.0
    rate = acceleration if abs(target) >= abs(velocity) else deceleration
    if target != velocity:
        phases.append((abs(target - velocity) / rate, math.copysign(rate, target - velocity)))
    return [*phases, (math.inf, 0.0)]


def stop_phases(velocity: float, deceleration: float) -> list[tuple[float, float]]:
    """Phases from `velocity` to rest."""
    return [(abs(velocity) / deceleration, -math.copysign(deceleration, velocity))] if velocity else []
