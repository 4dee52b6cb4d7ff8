"""The certificate of a program: every promise checked on the integers that the controller will get.

Nothing here is shared with the optimiser. Extremes of the cubics are closed forms: acceleration is linear inside a
segment, velocity a parabola, the distance from the chord a cubic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import (
    MAX_INCREMENT_COUNTS,
    MAX_SEGMENT_SAMPLES,
    MAX_VELOCITY_COUNTS_S,
    AxisProgram,
    IntArray,
    PvtProgram,
)
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.hermite import Cubics, excursion

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Check:
    """One promise: `value` must not be larger than `limit`."""

    name: str
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        """False also where the value is NaN."""
        return bool(self.value <= self.limit)


@dataclass(frozen=True)
class Certificate:
    """All checks of a program."""

    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """True where every check passed and there is at least one."""
        return bool(self.checks) and all(check.passed for check in self.checks)

    def __getitem__(self, name: str) -> Check:
        """The check of a name."""
        return next(check for check in self.checks if check.name == name)

    def summary(self) -> dict[str, object]:
        """JSON form: each check with its value and limit, and `passed`."""
        checks = {
            check.name: {"value": check.value, "limit": check.limit, "passed": check.passed} for check in self.checks
        }
        return {"passed": self.passed, "checks": checks}


def axis_cubics(program: PvtProgram, axis: AxisProgram) -> Cubics:
    """Segments of one axis in counts, counts/s and s, exactly as the controller will integrate them."""
    velocity = np.concatenate([[0.0], axis.end_velocity_counts_s.astype(np.float64)])
    position = axis.start_counts + np.concatenate([[0], np.cumsum(axis.increment_counts)]).astype(np.float64)
    return Cubics.through(position, velocity, program.time_s)


def certify(
    program: PvtProgram,
    machine: MachineDescription,
    path: ToolPath,
    time_s: FloatArray,
    source_segment: IntArray,
    corridor_mm: float | FloatArray,
) -> Certificate:
    """Check a program against the machine and the path it was made for.

    Parameters
    ----------
    program
        Integers.
    path, time_s
        What was asked for: every node must lie within half a count, and be reached within two samples of the sum of
        the times (n,) of the path's segments.
    source_segment : (segments of the program,) int64
        Segment of the path that each segment of the program belongs to.
    corridor_mm
        Largest allowed distance from a segment's chord; one, or (segments of the program,).
    """
    checks = []
    planar = {}
    # Node k of the path is where the last piece of its segment k - 1 ends.
    reached = np.searchsorted(source_segment, np.arange(path.segments + 1))
    for letter, axis in program.axes.items():
        limits = machine.axes[letter]  # type: ignore[index]
        cubics = axis_cubics(program, axis)
        scale = abs(axis.counts_per_mm)
        low, high = cubics.velocity_range
        move = axis.increment_counts
        backwards = np.where(move > 0, -low, high)[move != 0]
        standing = np.maximum(np.abs(low), np.abs(high))[move == 0]
        # Without reversal the extremes of the position are at the nodes.
        position_mm = np.concatenate([cubics.start, [axis.end_counts]]) / axis.counts_per_mm
        node_mm = path.x_mm if limits.coordinate == "x" else path.y_mm
        node_error_mm = np.abs(position_mm[reached] - node_mm)
        checks += [
            Check(f"peak_velocity_mm_s.{letter}", _largest(high, -low) / scale, limits.v_max_mm_s),
            Check(f"peak_acceleration_mm_s2.{letter}", _largest(cubics.peak_acceleration) / scale, limits.a_max_mm_s2),
            # To a millionth of a count/s: a velocity that just touches zero is no reversal.
            Check(f"reversal_counts_s.{letter}", round(float(np.maximum(_largest(backwards), 0.0)), 6), 0.0),
            Check(f"velocity_of_standing_axis_counts_s.{letter}", _largest(standing), 0.0),
            Check(f"velocity_at_end_counts_s.{letter}", float(abs(axis.end_velocity_counts_s[-1])), 0.0),
            # A node on the end of the travel may be rounded to the count beyond it.
            Check(f"below_travel_counts.{letter}", (limits.travel_min_mm - float(position_mm.min())) * scale, 0.5),
            Check(f"above_travel_counts.{letter}", (float(position_mm.max()) - limits.travel_max_mm) * scale, 0.5),
            Check(f"node_error_counts.{letter}", round(_largest(node_error_mm) * scale, 6), 0.5),
            Check(f"scale_mismatch_counts_per_mm.{letter}", abs(axis.counts_per_mm - limits.signed_counts_per_mm), 0.0),
            Check(f"largest_increment_counts.{letter}", _largest(np.abs(move)), MAX_INCREMENT_COUNTS),
            Check(
                f"largest_velocity_counts_s.{letter}",
                _largest(np.abs(axis.end_velocity_counts_s)),
                MAX_VELOCITY_COUNTS_S,
            ),
        ]
        if limits.j_max_mm_s3 is not None:
            jerk = _largest(np.abs(cubics.jerk)) / scale
            checks.append(Check(f"peak_jerk_mm_s3.{letter}", jerk, limits.j_max_mm_s3))
        planar[limits.coordinate] = Cubics(
            cubics.start / axis.counts_per_mm, cubics.move / axis.counts_per_mm,
            cubics.start_velocity / axis.counts_per_mm, cubics.end_velocity / axis.counts_per_mm, cubics.time_s,
        )  # fmt: skip
    samples = program.time_samples
    period_s = program.sample_period_s
    elapsed_s = np.concatenate([[0.0], np.cumsum(program.time_s)])[reached]
    time_error_s = np.abs(elapsed_s - np.concatenate([[0.0], np.cumsum(time_s)]))
    left_mm = excursion(planar["x"], planar["y"])
    allowed_mm = np.broadcast_to(corridor_mm, left_mm.shape)
    worst = int(np.argmax(left_mm / allowed_mm))
    checks += [
        Check("excursion_mm", float(left_mm[worst]), float(allowed_mm[worst])),
        Check("longest_segment_samples", _largest(samples), MAX_SEGMENT_SAMPLES),
        Check("shortest_segment_below_two_samples", float(np.maximum(2.0 - samples.min(), 0.0)), 0.0),
        Check("odd_segments", float((samples % 2).sum()), 0.0),
        Check("node_time_error_samples", round(_largest(time_error_s) / period_s, 6), 2.0),
        Check("sample_period_mismatch_s", abs(period_s - machine.sample_period_s), 0.0),
    ]
    return Certificate(tuple(checks))


def _largest(*values: NDArray[np.float64] | NDArray[np.int64]) -> float:
    """Largest of all values; zero where there are none; NaN where one is NaN."""
    present = [array.max() for array in values if array.size]
    return float(np.max(present)) if present else 0.0
