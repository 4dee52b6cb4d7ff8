"""Node velocities by a quadratic programme: the smoothest cubics through given nodes at given times.

Minimises the squared jumps of acceleration at the nodes (they would vanish for a cubic spline), subject to the
machine's limits inside every segment. Accelerations at both ends of a Hermite cubic are linear in the velocities
and bound it inside; so do the Bernstein coefficients of the velocity, whose middle one also forbids reversal.
The unconstrained optimum costs one banded solve; OSQP is asked only where it breaks a limit. No answer is taken
on its word: the certificate decides, from integers.

The formulation is a Hermite form of the scheduler of Wang et al. 2023, J. Manuf. Process. 88, Eqs. 8 to 18.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from ibfctl.schedule.programme import acceleration_jumps, solve_programme
from ibfctl.schedule.stretching import chord_velocities
from ibfctl.schedule.task import AxisTask, Tasks, limit_excess, stretches

FloatArray = NDArray[np.float64]

# Segments on either side of a broken one that are solved anew: a spline's memory of 0.27 a node leaves 1e-7.
_REACH = 12
# Rounds of resting beside what breaks a limit, before everything from stop to stop does.
_RESTS = 4


@dataclass(frozen=True)
class VelocitySolution:
    """Node velocities and what they break.

    Attributes
    ----------
    velocity_mm_s : pair of (n + 1,) float64
        One array per task.
    excess : (n,) float64
        By how much each segment exceeds its limits, relative to them; zero where everything holds.
    """

    velocity_mm_s: tuple[FloatArray, FloatArray]
    excess: FloatArray


@dataclass(frozen=True)
class Known:
    """What was solved, and its solution."""

    tasks: Tasks
    time_s: FloatArray
    solution: VelocitySolution

    def changed(self, tasks: Tasks, time_s: FloatArray) -> NDArray[np.bool_]:
        """Segments (n,) that are not what they were."""
        changed = time_s != self.time_s
        for task, earlier in zip(tasks, self.tasks, strict=True):
            changed |= task.move_mm != earlier.move_mm
            freed = task.free != earlier.free
            changed |= freed[1:] | freed[:-1]
        return np.asarray(changed)


def solve_velocities(
    tasks: Tasks,
    time_s: FloatArray,
    corridor_mm: float | FloatArray,
    *,
    last_resort: bool,
    known: Known | None = None,
    nearby: bool = False,
) -> VelocitySolution:
    """Choose the node velocities of both axes, rounded as the controller gets them.

    Parameters
    ----------
    tasks
        The two axes of the plane.
    time_s : (n,) float64
        Duration of each segment.
    corridor_mm
        Largest distance of the path from a segment's chord, one or (n,).
    last_resort
        Where the programme's answer breaks a limit, move along the chords: certain in `sufficient_samples`.
    known
        An earlier solution: where it has as many segments, stretches from stop to stop that are as they were keep
        their velocities.
    nearby
        Solve only around what breaks a limit or has changed, never a whole stretch from stop to stop.
    """
    velocities = (
        tasks[0].rounded(spline_velocities(tasks[0], time_s)),
        tasks[1].rounded(spline_velocities(tasks[1], time_s)),
    )
    if known is not None and known.time_s.size == time_s.size:
        changed = known.changed(tasks, time_s)
        kept = np.ones(time_s.size + 1, dtype=bool)
        if nearby:
            kept = ~_nodes_around(changed, _REACH, np.arange(time_s.size))
        else:
            kept[stretches(tasks, changed) + 1] = False
        for velocity, earlier in zip(velocities, known.solution.velocity_mm_s, strict=True):
            velocity[kept] = earlier[kept]
    excess = limit_excess(tasks, velocities, time_s, corridor_mm)
    # What one segment needs fades from node to node: solve around what breaks a limit, and only where that does
    # not do, the whole stretch from stop to stop. A long programme may leave more than a short one.
    tried = np.zeros(time_s.size + 1, dtype=bool)
    for reach in (_REACH,) if nearby else (_REACH, time_s.size):
        broken = excess > 0
        wanted = _nodes_around(broken, reach, stretches(tasks, broken))
        if not (wanted & ~tried).any():
            break
        tried |= wanted
        solved = solve_programme(tasks, time_s, corridor_mm, velocities, wanted)
        answer = tasks[0].rounded(solved[0]), tasks[1].rounded(solved[1])
        left = limit_excess(tasks, answer, time_s, corridor_mm)
        if left.sum() < excess.sum():
            velocities, excess = answer, left
        if last_resort:
            velocities, excess = _rest_where_broken(tasks, time_s, corridor_mm, velocities, excess)
    if excess.any() and last_resort:
        segments = stretches(tasks, excess > 0)
        chords = chord_velocities((tasks[0][segments], tasks[1][segments]), time_s[segments])
        for task, whole, solved_part in zip(tasks, velocities, chords, strict=True):
            whole[segments + 1] = task.rounded(solved_part[1:])
        excess = limit_excess(tasks, velocities, time_s, corridor_mm)
    return VelocitySolution(velocities, excess)


def _rest_where_broken(
    tasks: Tasks,
    time_s: FloatArray,
    corridor_mm: float | FloatArray,
    velocities: tuple[FloatArray, FloatArray],
    excess: FloatArray,
) -> tuple[tuple[FloatArray, FloatArray], FloatArray]:
    """Rest at both ends of what breaks a limit, and solve anew around it: it need not stop a whole path."""
    resting = np.zeros(time_s.size + 1, dtype=bool)
    for _ in range(_RESTS):
        broken = excess > 0
        if not broken.any():
            break
        resting[:-1] |= broken
        resting[1:] |= broken
        held = replace(tasks[0], free=tasks[0].free & ~resting), replace(tasks[1], free=tasks[1].free & ~resting)
        start = np.where(resting, 0.0, velocities[0]), np.where(resting, 0.0, velocities[1])
        wanted = _nodes_around(broken, _REACH, stretches(tasks, broken))
        solved = solve_programme(held, time_s, corridor_mm, start, wanted)
        velocities = tasks[0].rounded(solved[0]), tasks[1].rounded(solved[1])
        excess = limit_excess(tasks, velocities, time_s, corridor_mm)
    return velocities, excess


def _nodes_around(broken: NDArray[np.bool_], reach: int, stretch: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Nodes (n + 1,) of the segments `stretch` within `reach` segments of a broken one (n,)."""
    edge = np.zeros(broken.size + 1, dtype=np.int64)
    first = np.maximum(np.flatnonzero(broken) - reach, 0)
    last = np.minimum(np.flatnonzero(broken) + reach + 1, broken.size)
    np.add.at(edge, first, 1)
    np.add.at(edge, last, -1)
    near = np.zeros(broken.size, dtype=bool)
    near[stretch] = np.cumsum(edge)[:-1][stretch] > 0
    nodes = np.zeros(broken.size + 1, dtype=bool)
    nodes[:-1] |= near
    nodes[1:] |= near
    return nodes


def spline_velocities(task: AxisTask, time_s: FloatArray) -> FloatArray:
    """Velocities (n + 1,) of least squared acceleration jumps without limits, at rest at the nodes that must be."""
    free = task.free
    if not free.any():
        return np.zeros(free.size)
    before, here, after, constant = acceleration_jumps(task.move_mm, time_s)
    # Columns of fixed nodes drop out of the jump matrix.
    here = here * free
    before = before * np.concatenate([[False], free[:-1]])
    after = after * np.concatenate([free[1:], [False]])
    banded = np.zeros((3, free.size))
    banded[2] = here**2 + ~free
    banded[2, :-1] += before[1:] ** 2
    banded[2, 1:] += after[:-1] ** 2
    banded[1, 1:] = here[:-1] * after[:-1] + before[1:] * here[1:]
    banded[0, 2:] = before[1:-1] * after[1:-1]
    gradient = here * constant
    gradient[:-1] += before[1:] * constant[1:]
    gradient[1:] += after[:-1] * constant[:-1]
    # Unit diagonal: segment times differ by orders of magnitude.
    scale = 1 / np.sqrt(banded[2])
    banded[2] = 1.0
    banded[1, 1:] *= scale[1:] * scale[:-1]
    banded[0, 2:] *= scale[2:] * scale[:-2]
    solution = solveh_banded(banded, -gradient * scale, overwrite_ab=True, check_finite=False)
    return np.asarray(np.where(free, solution * scale, 0.0))
