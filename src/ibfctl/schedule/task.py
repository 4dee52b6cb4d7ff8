"""What each axis has to do, and by how much given velocities break its limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.schedule.hermite import Cubics, excursion

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class AxisTask:
    """What one axis has to do.

    Attributes
    ----------
    move_mm : (n,) float64
        Moves of the segments.
    v_max_mm_s : float
        Speed limit, rounding of the velocities already taken off.
    a_max_mm_s2 : (n,) float64
        Acceleration limit of each segment, rounding of the velocities already taken off.
    resolution_mm_s : float
        Step to which velocities will be rounded towards zero.
    free : (n + 1,) bool
        Nodes at which the axis may move, see `free_nodes`.
    """

    move_mm: FloatArray
    v_max_mm_s: float
    a_max_mm_s2: FloatArray
    resolution_mm_s: float
    free: NDArray[np.bool_]

    def __getitem__(self, segments: NDArray[np.int64]) -> AxisTask:
        """The same axis for some of the segments, whose stretches begin and end at rest."""
        free = self.free[np.concatenate([segments[:1], segments + 1])]
        return AxisTask(self.move_mm[segments], self.v_max_mm_s, self.a_max_mm_s2[segments], self.resolution_mm_s, free)


Tasks = tuple[AxisTask, AxisTask]


def free_nodes(move_counts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Nodes (n + 1,) at which an axis may move: not at the ends, at a reversal, or beside a segment at rest."""
    sign = np.sign(move_counts)
    free = np.zeros(move_counts.size + 1, dtype=bool)
    free[1:-1] = (sign[1:] == sign[:-1]) & (sign[1:] != 0)
    return free


def stretches(tasks: Tasks, wanted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Indices of all segments in the stretches that hold a wanted one, with the dead segment at either end.

    A segment is dead where both axes must rest at both of its ends: nothing is to be chosen there, and the
    accelerations on its two sides do not depend on each other.
    """
    free = tasks[0].free | tasks[1].free
    dead = ~(free[:-1] | free[1:])
    label = np.cumsum(dead)
    keep = np.zeros(label[-1] + 1, dtype=bool)
    keep[label[wanted]] = True
    inside = keep[label]
    closing = np.zeros_like(inside)
    closing[1:] = dead[1:] & inside[:-1]
    return np.flatnonzero(inside | closing)


def limit_excess(
    tasks: Tasks, velocities: tuple[FloatArray, FloatArray], time_s: FloatArray, corridor_mm: float
) -> FloatArray:
    """Relative excess of each segment (n,) over its limits, from the cubics themselves."""
    excess = np.zeros(time_s.size)
    cubics = []
    for task, velocity in zip(tasks, velocities, strict=True):
        segment = Cubics(np.zeros(time_s.size), task.move_mm, velocity[:-1], velocity[1:], time_s)
        low, high = segment.velocity_range
        np.maximum(excess, segment.peak_acceleration / task.a_max_mm_s2 - 1, out=excess)
        np.maximum(excess, np.maximum(-low, high) / task.v_max_mm_s - 1, out=excess)
        # Rounding towards zero keeps the middle Bernstein coefficient's sign, or else a velocity well above zero.
        mean = task.move_mm / time_s
        middle = 3 * mean - segment.start_velocity - segment.end_velocity
        slowest = np.where(mean < 0, -high, low)
        reversing = (mean != 0) & ((slowest < 0) | ((middle * mean < 0) & (slowest < 2 * task.resolution_mm_s)))
        speed = np.where(mean != 0, np.abs(mean), 1.0)
        backwards = np.maximum(-slowest, -middle * np.sign(mean)) / speed
        np.maximum(excess, np.where(reversing, backwards, 0.0), out=excess)
        cubics.append(segment)
    np.maximum(excess, excursion(*cubics) / corridor_mm - 1, out=excess)
    return np.where(excess > 1e-9, excess, 0.0)
