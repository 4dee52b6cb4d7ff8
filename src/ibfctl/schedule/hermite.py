"""Cubic segments given by positions and velocities at their ends (Hermite form).

With node positions and segment times given, the end velocities are the only unknowns of a PVT schedule, and
accelerations are linear in them. The formulas are section 3 of Galil's PVT mode: end position and end velocity
exact, start velocity inherited, jerk constant inside a segment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Cubics:
    """One axis' segments, each on its own local time from 0 to its duration.

    Attributes
    ----------
    start : (n,)
        Position at the start of each segment, any unit of length u.
    move : (n,)
        Position at the end minus position at the start, u.
    start_velocity, end_velocity : (n,)
        u/s.
    time_s : (n,)
        Durations.
    """

    start: FloatArray
    move: FloatArray
    start_velocity: FloatArray
    end_velocity: FloatArray
    time_s: FloatArray

    @classmethod
    def through(cls, position: FloatArray, velocity: FloatArray, time_s: FloatArray) -> Cubics:
        """Make the segments between nodes with `position` and `velocity` (n + 1,) in times `time_s` (n,)."""
        return cls(position[:-1], np.diff(position), velocity[:-1], velocity[1:], time_s)

    def position(self, tau_s: FloatArray) -> FloatArray:
        """Position at local times; `tau_s` is (n,) or (n, q), the result has its shape."""
        move, v0, v1, h = (_like(a, tau_s) for a in (self.move, self.start_velocity, self.end_velocity, self.time_s))
        c2 = 3 * move / h**2 - (2 * v0 + v1) / h
        c3 = (v0 + v1) / h**2 - 2 * move / h**3
        return np.asarray(_like(self.start, tau_s) + tau_s * (v0 + tau_s * (c2 + tau_s * c3)))

    def velocity(self, tau_s: FloatArray) -> FloatArray:
        """Velocity at local times, shapes as for `position`."""
        move, v0, v1, h = (_like(a, tau_s) for a in (self.move, self.start_velocity, self.end_velocity, self.time_s))
        c2 = 3 * move / h**2 - (2 * v0 + v1) / h
        c3 = (v0 + v1) / h**2 - 2 * move / h**3
        return np.asarray(v0 + tau_s * (2 * c2 + 3 * c3 * tau_s))

    @property
    def start_acceleration(self) -> FloatArray:
        """Acceleration at the start of each segment, (n,)."""
        return 6 * self.move / self.time_s**2 - (4 * self.start_velocity + 2 * self.end_velocity) / self.time_s

    @property
    def end_acceleration(self) -> FloatArray:
        """Acceleration at the end of each segment, (n,)."""
        return -6 * self.move / self.time_s**2 + (2 * self.start_velocity + 4 * self.end_velocity) / self.time_s

    @property
    def peak_acceleration(self) -> FloatArray:
        """Largest magnitude inside each segment, (n,): at an end, because acceleration is linear between."""
        return np.maximum(np.abs(self.start_acceleration), np.abs(self.end_acceleration))

    @property
    def jerk(self) -> FloatArray:
        """Rate of change of the acceleration, constant inside each segment, (n,)."""
        velocities = self.start_velocity + self.end_velocity
        return 6 * (velocities - 2 * self.move / self.time_s) / self.time_s**2

    @property
    def velocity_range(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest velocity inside each segment, (n,) each, vertex of the parabola included."""
        a0, a1 = self.start_acceleration, self.end_acceleration
        slope = a1 - a0
        with np.errstate(divide="ignore", invalid="ignore"):
            tau = np.where(slope != 0, -a0 * self.time_s / slope, 0.0)
        vertex = np.where((tau > 0) & (tau < self.time_s), self.start_velocity + 0.5 * a0 * tau, self.start_velocity)
        low = np.minimum(np.minimum(self.start_velocity, self.end_velocity), vertex)
        high = np.maximum(np.maximum(self.start_velocity, self.end_velocity), vertex)
        return low, high

    @property
    def acceleration_jumps(self) -> FloatArray:
        """Acceleration after minus before each node, (n + 1,); at rest before the first and after the last."""
        return np.asarray(np.append(self.start_acceleration, 0.0) - np.append(0.0, self.end_acceleration))


def _like(values: FloatArray, tau_s: FloatArray) -> FloatArray:
    return values if tau_s.ndim == 1 else values[:, None]


def excursion(first: Cubics, second: Cubics) -> FloatArray:
    """Largest distance of each segment's path from its chord, (n,), for two axes of a plane.

    Across the chord the motion is the cubic with zero move and the velocities' components across it; its extremes
    are the roots of a quadratic.
    """
    length = np.hypot(first.move, second.move)
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine, sine = np.where(length > 0, (first.move / length, second.move / length), ([1.0], [0.0]))
    across0 = cosine * second.start_velocity - sine * first.start_velocity
    across1 = cosine * second.end_velocity - sine * first.end_velocity
    h = first.time_s
    # d(u) = h (across0 u (1-u)^2 - across1 u^2 (1-u)), u in [0, 1]
    a, b, c = 3 * (across0 + across1), -2 * (2 * across0 + across1), across0
    root = np.sqrt(np.maximum(b * b - 4 * a * c, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -0.5 * (b + np.copysign(root, b))
        candidates = np.stack([q / a, c / q])
    u = np.clip(np.nan_to_num(candidates, nan=0.0, posinf=0.0, neginf=0.0), 0.0, 1.0)
    deviation = h * (across0 * u * (1 - u) ** 2 - across1 * u**2 * (1 - u))
    return np.asarray(np.abs(deviation).max(axis=0))
