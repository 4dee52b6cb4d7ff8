"""Times that are long enough: closed forms, for where the wanted ones break a limit.

With velocities of at most the mean speeds on either side of a node, along the chord where the path goes straight
on and zero where it turns, a segment needs  a h² + (4 u + 2 w) h >= 6 s  for its larger and smaller end speed u and
w, and under a limit j of the jerk  j h³ + 6 (u + w) h >= 12 s. Such times always admit a schedule; the programme then
finds a smoother one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ibfctl.machine.program import IntArray
from ibfctl.schedule.programme import SOLVER_MARGIN
from ibfctl.schedule.task import Tasks

FloatArray = NDArray[np.float64]

# Cosine and sine between segments up to which a path goes straight on.
_STRAIGHT = 1e-3
_ROUNDS = 1000
# What the programme keeps free of a limit for its tolerance, and as much again.
_ROOM = 1 - 2 * SOLVER_MARGIN


def sufficient_samples(tasks: Tasks, samples: IntArray, sample_period_s: float) -> IntArray:
    """Even durations (n,), none shorter than `samples`, that certainly admit a schedule along the chords."""
    length, direction = _chords(tasks)
    moving = length > 0
    with np.errstate(divide="ignore"):
        a_max = _ROOM * np.min(
            [task.a_max_mm_s2 / np.abs(part) for task, part in zip(tasks, direction, strict=True)], axis=0
        )
        v_max = _ROOM * np.min(
            [task.v_max_mm_s / np.abs(part) for task, part in zip(tasks, direction, strict=True)], axis=0
        )
        j_max = _ROOM * np.min(
            [task.j_max_mm_s3 / np.abs(part) for task, part in zip(tasks, direction, strict=True)], axis=0
        )
    straight = _straight(tasks, direction)
    # Speeds are rounded by up to a step at either end, and more along the chord where it is steep for the axis.
    step = np.max(
        [task.resolution_mm_s / np.maximum(np.abs(part), 1e-3) for task, part in zip(tasks, direction, strict=True)],
        axis=0,
    )
    needed = samples
    for _ in range(_ROUNDS):
        speed = _node_speeds(length / (needed * sample_period_s), straight)
        slow, fast = np.minimum(speed[1:], speed[:-1]), np.maximum(speed[1:], speed[:-1])
        push = 4 * slow + 2 * fast - np.where(fast > 0, 6 * step, 0.0)
        with np.errstate(invalid="ignore"):
            enough = 12 * length / (push + np.sqrt(push**2 + 24 * a_max * length))
            enough = np.maximum(enough, 3 * length / (v_max + slow + fast))
            enough = np.maximum(enough, _time_for_jerk(length, j_max, np.maximum(slow + fast - 2 * step, 0.0)))
        wanted = 2 * np.ceil(np.where(moving, enough, 0.0) / (2 * sample_period_s) - 1e-6).astype(np.int64)
        if (wanted <= needed).all():
            break
        needed = np.maximum(needed, wanted)
    return needed


def chord_velocities(tasks: Tasks, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Node velocities (n + 1,) of both axes along the chords, the lower of the mean speeds on either side."""
    length, direction = _chords(tasks)
    speed = _node_speeds(length / time_s, _straight(tasks, direction))
    along = np.concatenate([direction, direction[:, -1:]], axis=1)
    return speed * along[0] * tasks[0].free, speed * along[1] * tasks[1].free


def _time_for_jerk(length: FloatArray, j_max: FloatArray, end_speeds: FloatArray) -> FloatArray:
    """Root h of  j h³ + 6 (u + w) h = 12 s, without the cancellation of Cardano's difference; 0 without a limit."""
    third, half = 2 * end_speeds / j_max, 6 * length / j_max
    larger = np.cbrt(half + np.sqrt(half**2 + third**3))
    below = larger**2 + third + np.divide(third, larger, out=np.zeros_like(third), where=larger > 0) ** 2
    return np.asarray(np.divide(2 * half, below, out=np.zeros_like(half), where=below > 0))


def _chords(tasks: Tasks) -> tuple[FloatArray, FloatArray]:
    """Lengths (n,) and directions (2, n) of the segments; direction zero where nothing moves."""
    moves = np.stack([task.move_mm for task in tasks])
    length = np.hypot(*moves)
    return length, np.divide(moves, length, out=np.zeros_like(moves), where=length > 0)


def _straight(tasks: Tasks, direction: FloatArray) -> NDArray[np.bool_]:
    """Inner nodes (n - 1,) at which the path goes straight on."""
    along = (direction[:, 1:] * direction[:, :-1]).sum(axis=0)
    across = direction[0, :-1] * direction[1, 1:] - direction[1, :-1] * direction[0, 1:]
    straight = (along > 0) & (np.abs(across) < _STRAIGHT)
    for task in tasks:
        straight &= task.free[1:-1] | ((task.move_mm[1:] == 0) & (task.move_mm[:-1] == 0))
    return np.asarray(straight)


def _node_speeds(mean_speed: FloatArray, straight: NDArray[np.bool_]) -> FloatArray:
    """Speeds along the path at the nodes (n + 1,): zero where it turns."""
    speed = np.zeros(mean_speed.size + 1)
    speed[1:-1] = np.where(straight, np.minimum(mean_speed[1:], mean_speed[:-1]), 0.0)
    return speed
