"""Scheduling of a smoothed path: the times of its pieces, chosen so that the accelerations stay low.

A programmed segment has its time; how its half blocks and its leg share it is free. Pieces in which a spline through
the nodes would accelerate more than in the others of their segment get more of it. Where a limit is still broken, the
pieces around get longer, and nothing else does: a smoothed path has no stops between which to stretch the times.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import SolverError
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import IntArray, PvtProgram, seconds
from ibfctl.path.figures import distances_mm
from ibfctl.path.smoothing_pieces import SmoothedPath
from ibfctl.schedule.certificate import Certificate, Check, axis_cubics
from ibfctl.schedule.counting import even_samples
from ibfctl.schedule.hermite import Cubics, excursion
from ibfctl.schedule.scheduler import PvtSchedule, axis_tasks, counted_path, schedule
from ibfctl.schedule.task import AxisTask, free_nodes
from ibfctl.schedule.velocity import Known, solve_velocities, spline_velocities

FloatArray = NDArray[np.float64]

# Rounds in which the times of the pieces follow their accelerations, the power of them that they follow, and the
# largest change of a time in one.
_BALANCING_ROUNDS, _POWER, _LARGEST_STEP = 12, 0.3, 1.4
# Two speeds at the ends of a piece may add up to three times its mean speed before it reverses; a little less.
_MONOTONE = 2.9
_LENGTHENING_ROUNDS = 20


def balanced(smoothed: SmoothedPath, dwell_s: FloatArray, machine: MachineDescription) -> SmoothedPath:
    """Share the times (n,) of the segments among their pieces so that each comes equally near to the limits."""
    tasks = []
    for coordinate, node_mm in (("x", smoothed.pieces.x_mm), ("y", smoothed.pieces.y_mm)):
        axis, move_mm = machine.axis_of(coordinate), np.diff(node_mm)
        free = free_nodes(np.rint(move_mm * axis.counts_per_mm).astype(np.int64))
        jerk = np.inf if axis.j_max_mm_s3 is None else axis.j_max_mm_s3
        tasks.append(AxisTask(move_mm, axis.v_max_mm_s, axis.a_max_mm_s2, 1 / axis.counts_per_mm, free, jerk))
    whole_s = np.maximum(dwell_s, machine.sample_period_s)[smoothed.segment]
    time_s = smoothed.share * whole_s
    for _ in range(_BALANCING_ROUNDS):
        peak = np.maximum(*(_uses(task, time_s) for task in tasks))
        mean = (smoothed.sums(peak * time_s) / smoothed.sums(time_s))[smoothed.segment]
        wanted = np.divide(peak, mean, out=np.ones_like(peak), where=mean > 0) ** _POWER
        time_s = time_s * np.clip(wanted, 1 / _LARGEST_STEP, _LARGEST_STEP)
        time_s *= whole_s / smoothed.sums(time_s)[smoothed.segment]
    return replace(smoothed, share=time_s / whole_s)


def schedule_smoothed(
    smoothed: SmoothedPath,
    dwell_s: FloatArray,
    machine: MachineDescription,
    *,
    a_max_mm_s2: Mapping[str, float] | None = None,
) -> PvtSchedule:
    """Schedule a smoothed path with given times of its programmed segments; lengthen what the limits do not allow.

    Parameters
    ----------
    smoothed
        n programmed segments in pieces that share their times, see `balanced`.
    dwell_s : (n,) float64
        Times of the programmed segments.
    machine
        As for `schedule`.
    a_max_mm_s2
        Accelerations to stay below, by axis letter, beside the limits of the machine.

    Returns
    -------
    PvtSchedule
        Times and segments are those of the programmed path. Its certificate also bounds the distance of the motion
        from that path.

    Raises
    ------
    InputError, LimitsError, SolverError
        As `schedule` does.
    """
    limited = machine if a_max_mm_s2 is None else _with_accelerations(machine, a_max_mm_s2)
    samples = _whole_pairs(smoothed, even_samples(dwell_s, machine.sample_period_s))
    samples = _lengthened(smoothed, samples, limited)
    scheduled = schedule(
        smoothed.pieces,
        seconds(samples, machine.sample_period_s),
        limited,
        smoothed.corridor_mm,
        stretch=True,
    )
    limits = {f"peak_acceleration_mm_s2.{letter}": axis.a_max_mm_s2 for letter, axis in machine.axes.items()}
    checks = [replace(check, limit=limits.get(check.name, check.limit)) for check in scheduled.certificate.checks]
    deviation_mm = _deviation_mm(smoothed, scheduled.program, scheduled.source_segment)
    if not deviation_mm <= smoothed.tolerance_mm:
        raise SolverError(
            f"schedule: the motion may leave the programmed path by {deviation_mm:.6g} mm, more than the corner "
            f"tolerance of {smoothed.tolerance_mm:g} mm",
            "this is a defect of the scheduler: keep the input files and report it",
        )
    return PvtSchedule(
        scheduled.program,
        Certificate((*checks, Check("deviation_mm", deviation_mm, smoothed.tolerance_mm))),
        smoothed.sums(scheduled.segment_time_s),
        smoothed.segment[scheduled.source_segment],
    )


def _with_accelerations(machine: MachineDescription, a_max_mm_s2: Mapping[str, float]) -> MachineDescription:
    axes = {
        letter: axis.model_copy(update={"a_max_mm_s2": min(axis.a_max_mm_s2, a_max_mm_s2[letter])})
        for letter, axis in machine.axes.items()
    }
    return machine.model_copy(update={"axes": axes})


def _uses(task: AxisTask, time_s: FloatArray) -> FloatArray:
    """Shares (m,) of the limits that the spline takes, its velocities lowered where a piece would reverse."""
    velocity = np.abs(spline_velocities(task, time_s))
    move = np.abs(task.move_mm)
    both = velocity[1:] + velocity[:-1]
    most = np.divide(_MONOTONE * move / time_s, both, out=np.ones_like(both), where=both > 0)
    allowed = np.minimum(1.0, most)
    velocity *= np.minimum(np.append(allowed, 1.0), np.append(1.0, allowed))
    cubics = Cubics(np.zeros(move.size), move, velocity[:-1], velocity[1:], time_s)
    return np.maximum(cubics.peak_acceleration / task.a_max_mm_s2, np.abs(cubics.jerk) / task.j_max_mm_s3)


def _whole_pairs(smoothed: SmoothedPath, segment_samples: IntArray) -> IntArray:
    """Even samples (m,) of the pieces that add up to those of their segments (n,), one pair each at the least.

    What is left over goes to the pieces that rounding down has shortened by the largest share.
    """
    whole = segment_samples // 2
    wanted = smoothed.share * whole[smoothed.segment]
    pairs = np.maximum(np.floor(wanted), 1.0)
    while True:
        left = (whole - smoothed.sums(pairs))[smoothed.segment]
        if not (left > 0).any():
            return 2 * pairs.astype(np.int64)
        order = np.lexsort((wanted / pairs, smoothed.segment))
        largest = order[np.append(np.diff(smoothed.segment[order]) > 0, True)]
        pairs[largest[left[largest] > 0]] += 1


def _lengthened(smoothed: SmoothedPath, samples: IntArray, machine: MachineDescription) -> IntArray:
    """Lengthen the pieces (m,) that break a limit until none does, or lengthening them does not help."""
    moving = np.zeros(smoothed.pieces.segments, dtype=bool)
    known: Known | None = None
    for _ in range(_LENGTHENING_ROUNDS):
        counted = counted_path(smoothed.pieces, samples, machine, moving)
        tasks = axis_tasks(counted, machine, moving)
        time_s = seconds(counted.time_samples, machine.sample_period_s)
        excess = np.zeros(samples.size)
        corridor_mm = smoothed.corridor_mm[counted.source_segment]
        solution = solve_velocities(tasks, time_s, corridor_mm, last_resort=False, known=known, nearby=True)
        known = Known(tasks, time_s, solution)
        np.maximum.at(excess, counted.source_segment, solution.excess)
        if not excess.any():
            break
        # An acceleration falls with the square of the time; half of the way, because the neighbours get longer too.
        pairs = np.ceil(0.25 * (np.sqrt(1 + np.minimum(excess, 3.0)) - 1) * samples)
        samples = samples + np.where(excess > 0, 2 * np.maximum(pairs, 1), 0).astype(np.int64)
    return samples


def _deviation_mm(smoothed: SmoothedPath, program: PvtProgram, piece: IntArray) -> float:
    """Upper bound of the distance between the motion and the programmed path, from the program's integers.

    The motion leaves a chord by its excursion, and a chord is nowhere farther from a segment than its ends. The other
    way round, nothing of the path is farther from the motion than a corner from the middle of its block.
    """
    cubics, nodes = [], []
    for coordinate in ("x", "y"):
        axis = program.axis_of(coordinate)
        counted, scale = axis_cubics(program, axis), axis.counts_per_mm
        cubics.append(
            Cubics(
                counted.start / scale,
                counted.move / scale,
                counted.start_velocity / scale,
                counted.end_velocity / scale,
                counted.time_s,
            )
        )
        nodes.append(np.append(counted.start, axis.end_counts) / scale)
    at = np.column_stack(nodes)
    path = smoothed.corners.path
    programmed = np.column_stack([path.x_mm, path.y_mm])
    segment = smoothed.segment[piece]
    starts, moves = programmed[segment], np.diff(programmed, axis=0)[segment]
    ends = np.maximum(distances_mm(at[:-1], starts, moves), distances_mm(at[1:], starts, moves))
    last = np.append(np.flatnonzero(np.diff(segment)), segment.size - 1)
    corners = np.hypot(*(at[last + 1] - programmed[segment[last] + 1]).T)
    return float(max((ends + excursion(*cubics)).max(), corners.max()))
