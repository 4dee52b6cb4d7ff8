"""How the axes move along a smoothed path, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.schedule.kinematics import CORNER_LIMITS, CornerTiming, blocks_of, lines_of
from ibfctl.schedule.kinematics_blocks import Step, traverse

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# What may bind at a sample: in a block what sets its speed, on a leg what its phase is limited by.
BINDING = (*CORNER_LIMITS, "jerk", "acceleration")
_PHASES = np.array([BINDING.index(name) for name in ("jerk", "acceleration", "jerk", "feed")])
_PHASE_BINDING = np.concatenate([_PHASES, _PHASES[:3]])


@dataclass(frozen=True)
class AxisProfile:
    """Motion of both axes at the samples of the interpolator; every leg and every block ends with a sample.

    Attributes
    ----------
    time_s : (k,) float64
        Since the start.
    position_mm, velocity_mm_s, acceleration_mm_s2 : (2, k) float64
        Of x and y.
    binding : (k,) int64
        What limits the motion: an index of `BINDING`.
    """

    time_s: FloatArray
    position_mm: FloatArray
    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    binding: IntArray


def axis_profile(timing: CornerTiming) -> AxisProfile:
    """Sample the motion of a timed path."""
    legs, blocks = _legs(timing), _blocks(timing)
    # In the order of the path: leg k, block at node k, leg k + 1; within each the order of its samples is kept.
    owner, piece_s, *parts = (np.concatenate([leg, block], axis=-1) for leg, block in zip(legs, blocks, strict=True))
    order = np.argsort(owner, kind="stable")
    position, velocity, acceleration, binding = (part[..., order] for part in parts)
    return AxisProfile(np.cumsum(piece_s[order]), position, velocity, acceleration, binding)


_Samples = tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray, IntArray]


def _legs(timing: CornerTiming) -> _Samples:
    """Samples of the legs: place in the path, time since the last sample, motion, what binds."""
    corners, sample_s = timing.corners, timing.drive.sample_s
    lines = lines_of(corners, timing.drive, timing.feed_mm_s)
    first = np.concatenate([[0.0], timing.exit_mm_s])
    phase_s, jerk = lines.phases(first, np.concatenate([timing.entry_mm_s, [0.0]]))
    count = np.where(timing.leg_s > 0, np.maximum(np.ceil(timing.leg_s / sample_s - 1e-9), 1), 0).astype(np.int64)
    leg = np.repeat(np.arange(count.size), count)
    ordinal = np.arange(leg.size) - np.repeat(np.cumsum(count) - count, count)
    when = np.minimum((ordinal + 1) * sample_s, timing.leg_s[leg])
    way, speed, push = np.zeros(leg.size), first[leg], np.zeros(leg.size)
    binding = np.full(leg.size, _PHASE_BINDING[0])
    ends = np.cumsum(phase_s, axis=0)
    for phase in range(7):
        begin = ends[phase, leg] - phase_s[phase, leg]
        tau = np.clip(when - begin, 0.0, phase_s[phase, leg])
        j = jerk[phase, leg]
        way += tau * (speed + tau * (push / 2 + tau * j / 6))
        speed, push = speed + tau * (push + tau * j / 2), push + tau * j
        binding = np.where(when > begin, _PHASE_BINDING[phase], binding)
    path = corners.path
    nodes = np.stack([path.x_mm, path.y_mm])
    move, length = np.diff(nodes, axis=1), path.length_mm
    along = np.divide(move, length, out=np.zeros_like(move), where=length > 0)
    start = nodes[:, :-1] + np.concatenate([[0.0], corners.transition_mm]) * along
    unit = along[:, leg]
    elapsed = when - ordinal * sample_s
    return 2 * leg, elapsed, start[:, leg] + way * unit, speed * unit, push * unit, binding


def _blocks(timing: CornerTiming) -> _Samples:
    """Samples of the blocks, as of the legs."""
    corners = timing.corners
    rounded = np.flatnonzero(corners.transition_mm > 0)
    blocks = blocks_of(corners, timing.drive)[rounded]
    steps: list[Step] = []
    traverse(blocks, timing.entry_mm_s[rounded], timing.speed_limits_mm_s, steps)
    if not steps:
        nothing, pair = np.zeros(0), np.zeros((2, 0))
        return np.zeros(0, dtype=np.int64), nothing, pair, pair, pair, np.zeros(0, dtype=np.int64)
    which, u, speed, push, elapsed = (
        np.concatenate([getattr(step, name) for step in steps])
        for name in ("block", "u", "speed_mm_s", "acceleration_mm_s2", "time_s")
    )
    node = rounded[which]
    cubic, square, line, start = corners.coefficients_mm[:, :, node]
    tangent = line + u * (2 * square + 3 * u * cubic)
    tangent /= np.hypot(*tangent)
    place = blocks[which].at(u)
    normal = np.stack([-tangent[1], tangent[0]])
    position = start + u * (line + u * (square + u * cubic))
    acceleration = push * tangent + speed**2 * place.curvature * normal
    return 2 * node + 1, elapsed, position, speed * tangent, acceleration, timing.binding[node]
