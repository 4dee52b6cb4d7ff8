"""What any scheduler makes the axes do: polynomial pieces in time, and the figures by which schedulers are compared."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ibfctl.path.figures import distances_mm
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.certificate import axis_cubics
from ibfctl.schedule.scheduler import PvtSchedule

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Gauss points in time on every piece, as many as a prediction along cubics takes.
POINTS = 8
# A millionth of a micrometre is arithmetic, not motion.
_DIGITS_MM = 9


@dataclass(frozen=True)
class AxisMotion:
    """One axis: pieces with constant jerk, one after the other.

    Attributes
    ----------
    segment : (m,) int64
        Segment of the path that each piece belongs to, ascending.
    time_s : (m,) float64
        Durations.
    position_mm, velocity_mm_s, acceleration_mm_s2 : (m,) float64
        At the start of each piece.
    jerk_mm_s3 : (m,) float64
        Throughout each piece.
    """

    segment: IntArray
    time_s: FloatArray
    position_mm: FloatArray
    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    jerk_mm_s3: FloatArray

    @cached_property
    def start_s(self) -> FloatArray:
        """When each piece starts, and the last ends, (m + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.time_s)])

    @property
    def end_acceleration_mm_s2(self) -> FloatArray:
        """Acceleration at the end of each piece, (m,)."""
        return self.acceleration_mm_s2 + self.jerk_mm_s3 * self.time_s

    @property
    def peak_acceleration_mm_s2(self) -> float:
        """Largest magnitude of the acceleration: at an end of a piece."""
        return float(np.maximum(np.abs(self.acceleration_mm_s2), np.abs(self.end_acceleration_mm_s2)).max())

    @property
    def acceleration_jumps_mm_s2(self) -> FloatArray:
        """Jumps of the acceleration between the pieces, (m + 1,); none before the first and after the last."""
        return np.asarray(np.append(self.acceleration_mm_s2, 0.0) - np.append(0.0, self.end_acceleration_mm_s2))

    def position(self, time_s: FloatArray) -> FloatArray:
        """Positions in mm at any times since the start."""
        piece = np.clip(np.searchsorted(self.start_s, time_s, side="right") - 1, 0, self.time_s.size - 1)
        return self._position(piece, time_s - self.start_s[piece])

    def position_range(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest position in each piece, (m,) each, turning points included."""
        piece = np.arange(self.time_s.size)
        velocity, acceleration, jerk = self.velocity_mm_s, self.acceleration_mm_s2, self.jerk_mm_s3
        root = np.sqrt(np.maximum(acceleration**2 - 2 * velocity * jerk, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            # The form of the quadratic's roots that does not cancel.
            q = -(acceleration + np.copysign(root, acceleration))
            turning = np.stack([q / jerk, 2 * velocity / q])
        turning = np.clip(np.nan_to_num(turning, nan=0.0, posinf=0.0, neginf=0.0), 0.0, self.time_s)
        places = [self._position(piece, tau) for tau in (0 * self.time_s, self.time_s, *turning)]
        return np.min(places, axis=0), np.max(places, axis=0)

    def _position(self, piece: IntArray, tau_s: FloatArray) -> FloatArray:
        third = self.acceleration_mm_s2[piece] / 2 + tau_s * self.jerk_mm_s3[piece] / 6
        return np.asarray(self.position_mm[piece] + tau_s * (self.velocity_mm_s[piece] + tau_s * third))


@dataclass(frozen=True)
class Motion:
    """Both axes on one clock.

    Attributes
    ----------
    path
        What the motion is to follow, segment by segment.
    x, y
        The axes; both end at the same time.
    """

    path: ToolPath
    x: AxisMotion
    y: AxisMotion

    @property
    def total_time_s(self) -> float:
        """Run time."""
        return float(self.x.time_s.sum())

    @property
    def overshoot_mm(self) -> float:
        """How far an axis leaves the range between the two ends of the segment that it is on."""
        largest = 0.0
        for axis, node_mm in ((self.x, self.path.x_mm), (self.y, self.path.y_mm)):
            low, high = axis.position_range()
            first, last = node_mm[:-1][axis.segment], node_mm[1:][axis.segment]
            beyond = np.maximum(high - np.maximum(first, last), np.minimum(first, last) - low)
            largest = max(largest, float(beyond.max()))
        return round(largest, _DIGITS_MM)

    @property
    def excursion_mm(self) -> float:
        """Largest distance of the motion from the segment that it is on, over all samples."""
        x_mm, y_mm, _, segment = self.samples()
        starts = np.column_stack([self.path.x_mm[:-1], self.path.y_mm[:-1]])[segment]
        moves = np.column_stack([np.diff(self.path.x_mm), np.diff(self.path.y_mm)])[segment]
        return round(float(distances_mm(np.column_stack([x_mm, y_mm]), starts, moves).max()), _DIGITS_MM)

    @property
    def largest_acceleration_jump_mm_s2(self) -> float:
        """Largest jump of an axis' acceleration."""
        return float(max(np.abs(axis.acceleration_jumps_mm_s2).max() for axis in (self.x, self.y)))

    @property
    def rms_acceleration_jump_mm_s2(self) -> float:
        """Root of the sum of all squared jumps of both axes over the number of segments.

        It does not depend on how many pieces a scheduler cuts a segment into.
        """
        squares = sum(float((axis.acceleration_jumps_mm_s2**2).sum()) for axis in (self.x, self.y))
        return float(np.sqrt(squares / self.path.segments))

    @property
    def peak_acceleration_mm_s2(self) -> dict[str, float]:
        """Largest acceleration by coordinate."""
        return {"x": self.x.peak_acceleration_mm_s2, "y": self.y.peak_acceleration_mm_s2}

    def samples(self, points: int = POINTS) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Gauss points in time on every stretch where neither axis changes its polynomial.

        Returns
        -------
        x_mm, y_mm, time_s : (k,) float64
            Where, and for how long around there.
        segment : (k,) int64
            Segment of the path that each belongs to.
        """
        ends_s = np.union1d(self.x.start_s, self.y.start_s)
        duration_s = np.diff(ends_s)
        node, weight = np.polynomial.legendre.leggauss(points)
        when_s = (ends_s[:-1, None] + 0.5 * (node + 1) * duration_s[:, None]).ravel()
        piece = np.clip(np.searchsorted(self.x.start_s, when_s, side="right") - 1, 0, self.x.segment.size - 1)
        time_s = (0.5 * weight * duration_s[:, None]).ravel()
        return self.x.position(when_s), self.y.position(when_s), time_s, self.x.segment[piece]


def motion_of_schedule(scheduled: PvtSchedule) -> Motion:
    """Motion of a PVT program, along the path between its nodes on the grid of counts."""
    program = scheduled.program
    # A long dwell is split into several pieces of one segment.
    _, first = np.unique(scheduled.source_segment, return_index=True)
    nodes, axes = [], []
    for coordinate in ("x", "y"):
        axis = program.axis_of(coordinate)
        scale = axis.counts_per_mm
        cubics = axis_cubics(program, axis)
        nodes.append(np.append(cubics.start[first], axis.end_counts) / scale)
        axes.append(
            AxisMotion(
                scheduled.source_segment,
                program.time_s,
                cubics.start / scale,
                cubics.start_velocity / scale,
                cubics.start_acceleration / scale,
                cubics.jerk / scale,
            )
        )
    return Motion(ToolPath(*nodes), *axes)
