"""Constant acceleration: on every segment an axis accelerates with all it has, then keeps its velocity.

Wang et al. 2023, J. Manuf. Process. 88, Eqs. 3 to 7, each axis for itself. The paper leaves open what two axes do
when Eq. 7 changes the time of one of them. Here both take the changed time if the other can; otherwise the least
longer time in which both reach the node, if need be on the way back from beyond it. After the last node the paper's
motion simply ends, at whatever velocity it has.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ibfctl.machine.description import Axis, MachineDescription
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.baselines.motion import AxisMotion, Motion

FloatArray = NDArray[np.float64]


def constant_acceleration(path: ToolPath, dwell_s: FloatArray, machine: MachineDescription) -> Motion:
    """Move along a path with the largest acceleration of each axis.

    Parameters
    ----------
    path
        Nodes in mm.
    dwell_s : (n,) float64
        Time of each segment, above zero.
    machine
        Its limits of velocity and acceleration.
    """
    x = _Record(machine.axis_of("x"), float(path.x_mm[0]))
    y = _Record(machine.axis_of("y"), float(path.y_mm[0]))
    for segment, time_s in enumerate(dwell_s.tolist()):
        targets = float(path.x_mm[segment + 1]), float(path.y_mm[segment + 1])
        for axis, move in zip((x, y), _in_step((x, y), targets, time_s), strict=True):
            axis.take(move, segment)
    return Motion(path, x.motion(), y.motion())


def _in_step(axes: tuple[_Record, _Record], targets_mm: tuple[float, float], time_s: float) -> tuple[Move, Move]:
    """Moves of both axes in one time: the one asked for, or that of Eq. 7, or the least longer one."""

    def moves(tried_s: float) -> tuple[Move, Move]:
        return axes[0].move_to(targets_mm[0], tried_s), axes[1].move_to(targets_mm[1], tried_s)

    def together(found: tuple[Move, Move], tried_s: float) -> bool:
        return all(math.isclose(move.time_s, tried_s, rel_tol=1e-9) for move in found)

    asked = moves(time_s)
    if together(asked, time_s):
        return asked
    for move in asked:
        if move.time_s > 0 and together(changed := moves(move.time_s), move.time_s):
            return changed
    later = asked
    while not together(later, time_s):
        time_s = max(move.later_s for move in later)
        later = moves(time_s)
    return later


@dataclass(frozen=True)
class Move:
    """One axis on one segment: acceleration for a while, then the velocity reached.

    Attributes
    ----------
    acceleration_mm_s2, accelerating_s
        Of the first part.
    velocity_mm_s
        At its end, kept in the second part.
    time_s
        Of both parts; not the time asked for where Eq. 7 or the limit of velocity applies.
    later_s
        The least time, not below the one asked for, in which the node is reached.
    """

    acceleration_mm_s2: float
    accelerating_s: float
    velocity_mm_s: float
    time_s: float
    later_s: float


def accelerate(move_mm: float, time_s: float, velocity_mm_s: float, v_max_mm_s: float, a_max_mm_s2: float) -> Move:
    """Find the velocity after a segment from the one before it, Eqs. 4 to 7."""
    before, mean = velocity_mm_s, move_mm / time_s
    if mean == before:
        return Move(0.0, 0.0, before, time_s, time_s)
    a = math.copysign(a_max_mm_s2, mean - before)
    discriminant = (before + a * time_s) ** 2 - (before**2 + 2 * a * move_mm)
    taken_s = later_s = time_s
    # Where a segment takes just the time of Eq. 7, rounding leaves the discriminant a little off zero.
    if discriminant >= -1e-9 * (before**2 + (a * time_s) ** 2):
        # Eqs. 5 and 6: the root that the acceleration reaches within the segment.
        after = before + a * time_s - math.copysign(math.sqrt(max(discriminant, 0.0)), a)
    else:
        # Eq. 7, in the direction of the move.
        root = math.sqrt(max(before**2 + 2 * a * move_mm, 0.0))
        after = math.copysign(root, move_mm or before)
        taken_s = (after - before) / a
        later_s = (math.copysign(root, a) - before) / a
    if abs(after) > v_max_mm_s:
        after = math.copysign(v_max_mm_s, after)
        accelerating_s = (after - before) / a
        taken_s = accelerating_s + (move_mm - 0.5 * (before + after) * accelerating_s) / after
        return Move(a, accelerating_s, after, taken_s, max(later_s, taken_s))
    return Move(a, (after - before) / a, after, taken_s, later_s)


@dataclass
class _Record:
    """An axis under way: where it is, and the pieces behind it."""

    axis: Axis
    position_mm: float
    velocity_mm_s: float = 0.0
    pieces: list[tuple[int, float, float, float, float]] = field(default_factory=list)

    def move_to(self, target_mm: float, time_s: float) -> Move:
        return accelerate(
            target_mm - self.position_mm, time_s, self.velocity_mm_s, self.axis.v_max_mm_s, self.axis.a_max_mm_s2
        )

    def take(self, move: Move, segment: int) -> None:
        """Make a move."""
        parts = (move.acceleration_mm_s2, move.accelerating_s), (0.0, move.time_s - move.accelerating_s)
        for acceleration, duration in parts:
            if duration > 0:
                self.pieces.append((segment, duration, self.position_mm, self.velocity_mm_s, acceleration))
                self.position_mm += duration * (self.velocity_mm_s + 0.5 * acceleration * duration)
                self.velocity_mm_s += acceleration * duration

    def motion(self) -> AxisMotion:
        segment, time_s, position_mm, velocity_mm_s, acceleration_mm_s2 = np.array(self.pieces).T
        return AxisMotion(
            segment.astype(np.int64), time_s, position_mm, velocity_mm_s, acceleration_mm_s2, np.zeros(segment.size)
        )
