"""What each axis has to do, and by how much given velocities break its limits."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
    v_max_mm_s, a_max_mm_s2 : float
        Limits.
    resolution_mm_s : float
        Step to which velocities are rounded, towards zero.
    free : (n + 1,) bool
        Nodes at which the axis may move, see `free_nodes`.
    j_max_mm_s3 : float
        Limit of the jerk inside the segments, infinite where there is none.
    """

    move_mm: FloatArray
    v_max_mm_s: float
    a_max_mm_s2: float
    resolution_mm_s: float
    free: NDArray[np.bool_]
    j_max_mm_s3: float = np.inf

    def rounded(self, velocity_mm_s: FloatArray) -> FloatArray:
        """Velocities (n + 1,) as the controller will get them."""
        return np.asarray(np.trunc(velocity_mm_s / self.resolution_mm_s) * self.resolution_mm_s)

    def __getitem__(self, segments: NDArray[np.int64]) -> AxisTask:
        """The same axis for some of the segments, whose stretches begin and end at rest."""
        free = self.free[np.concatenate([segments[:1], segments + 1])]
        return replace(self, move_mm=self.move_mm[segments], free=free)


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
    tasks: Tasks, velocities: tuple[FloatArray, FloatArray], time_s: FloatArray, corridor_mm: float | FloatArray
) -> FloatArray:
    """Relative excess of each segment (n,) over its limits, from the cubics that the controller will execute."""
    excess = np.zeros(time_s.size)
    cubics = []
    for task, velocity in zip(tasks, velocities, strict=True):
        segment = Cubics(np.zeros(time_s.size), task.move_mm, velocity[:-1], velocity[1:], time_s)
        low, high = segment.velocity_range
        np.maximum(excess, segment.peak_acceleration / task.a_max_mm_s2 - 1, out=excess)
        np.maximum(excess, np.maximum(-low, high) / task.v_max_mm_s - 1, out=excess)
        if np.isfinite(task.j_max_mm_s3):
            np.maximum(excess, np.abs(segment.jerk) / task.j_max_mm_s3 - 1, out=excess)
        mean = task.move_mm / time_s
        backwards = np.where(mean < 0, high, -low) / np.where(mean != 0, np.abs(mean), np.inf)
        np.maximum(excess, backwards, out=excess)
        cubics.append(segment)
    np.maximum(excess, excursion(*cubics) / corridor_mm - 1, out=excess)
    # Rounding of this arithmetic itself; the certificate repeats it in counts.
    return np.where(excess <= 1e-12, 0.0, np.where(np.isnan(excess), np.inf, excess))
