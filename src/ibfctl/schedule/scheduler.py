"""From a timed path to a certified program of integers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import LimitsError, SolverError
from ibfctl.machine.description import Axis, MachineDescription
from ibfctl.machine.program import AxisProgram, IntArray, PvtProgram
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.certificate import Certificate, certify
from ibfctl.schedule.counting import CountedPath, count_path
from ibfctl.schedule.stretching import sufficient_samples
from ibfctl.schedule.task import AxisTask, Tasks, free_nodes, stretches
from ibfctl.schedule.velocity import solve_velocities

FloatArray = NDArray[np.float64]

# Parts of the way to times that certainly do, tried one after the other where the wanted times break a limit.
_SHARES = (0.2, 0.4, 0.6, 0.8, 1.0, 1.0, 1.0, 1.0)


@dataclass(frozen=True)
class PvtSchedule:
    """A certified program and the times it really takes.

    Attributes
    ----------
    program
        What the controller gets.
    certificate
        Checks on the program's integers, all passed.
    segment_time_s : (n,) float64
        Executed time of each segment of the path.
    source_segment : (segments of the program,) int64
        Segment of the path that each segment of the program belongs to.
    """

    program: PvtProgram
    certificate: Certificate
    segment_time_s: FloatArray
    source_segment: IntArray


def schedule(
    path: ToolPath, dwell_s: FloatArray, machine: MachineDescription, corridor_mm: float, *, stretch: bool = False
) -> PvtSchedule:
    """Schedule a path with given dwell times as cubic PVT motion within the machine's limits.

    Parameters
    ----------
    path
        Nodes in mm.
    dwell_s : (n,) float64
        Time of each segment, from its first node to its last.
    machine
        Scales and limits.
    corridor_mm
        How far the motion may leave the straight line between two nodes.
    stretch
        Lengthen the times of segments that the limits do not allow, instead of refusing.

    Raises
    ------
    LimitsError
        If the limits cannot be met in the given times (without `stretch`), with the nodes that need more time;
        or if the path leaves the travel of an axis.
    SolverError
        If no velocities pass the certificate.
    """
    _check_times(dwell_s, path)
    counted = count_path(path, dwell_s, machine)
    asked = counted.time_samples
    needed = np.maximum(asked, shortest_samples(counted, machine))
    for share in _SHARES:
        time_s = needed * machine.sample_period_s
        tasks = _tasks(counted, machine, time_s)
        solution = solve_velocities(tasks, time_s, corridor_mm)
        if not solution.excess.any():
            break
        needed = _longer(tasks, needed, solution.excess, machine.sample_period_s, share)
    else:
        raise SolverError(
            f"schedule: limits still exceeded by {solution.excess.max():.2%} in times that should do",
            "use longer dwell times or a wider corridor",
        )
    if not stretch and (needed > asked).any():
        raise _times_too_short(path, counted, asked, needed, machine.sample_period_s)
    executed = replace(counted, time_samples=needed)
    program = _program(executed, solution.velocity_mm_s, machine)
    total_s = float(dwell_s.sum() + (needed - asked).sum() * machine.sample_period_s)
    certificate = certify(program, machine, path, total_s, corridor_mm)
    if not certificate.passed:
        failed = next(check for check in certificate.checks if not check.passed)
        raise SolverError(
            f"schedule: certificate fails at {failed.name}: {failed.value:.6g} over the limit of {failed.limit:.6g}",
            "this is a defect of the scheduler: keep the input files and report it",
        )
    segment_time_s = np.bincount(executed.source_segment, time_s, minlength=path.segments).astype(np.float64)
    return PvtSchedule(program, certificate, segment_time_s, executed.source_segment)


def shortest_times(path: ToolPath, machine: MachineDescription) -> FloatArray:
    """Times (n,) of the fastest motion along the path that certainly keeps the limits: lower bounds for dwell times.

    Whole numbers of sample pairs, in seconds: rounding the running sum of longer times never falls below them.
    """
    counted = count_path(path, np.zeros(path.segments), machine)
    shortest = shortest_samples(counted, machine)
    tasks = _tasks(counted, machine, shortest * machine.sample_period_s)
    return np.asarray(sufficient_samples(tasks, shortest, machine.sample_period_s) * machine.sample_period_s)


def shortest_samples(counted: CountedPath, machine: MachineDescription) -> IntArray:
    """Even samples (n,) below which a segment breaks a limit whatever its neighbours do.

    From rest to rest a cubic needs time sqrt(6 s/a) and reaches 1.5 times its mean speed; with one end at
    rest sqrt(2 s/a); between moving ends only the speed limit counts.
    """
    shortest_s = np.zeros(counted.time_samples.size)
    for letter, axis in machine.axes.items():
        move_mm = np.abs(np.diff(counted.position_counts[letter])) / axis.counts_per_mm
        free = free_nodes(np.diff(counted.position_counts[letter]))
        ends_at_rest = 2 - free[:-1].astype(int) - free[1:].astype(int)
        speed = np.choose(ends_at_rest, [1.0, 1.0, 1.5]) * move_mm / axis.v_max_mm_s
        push = np.sqrt(np.choose(ends_at_rest, [0.0, 2.0, 6.0]) * move_mm / axis.a_max_mm_s2)
        shortest_s = np.maximum(shortest_s, np.maximum(speed, push))
    return 2 * np.maximum(np.ceil(0.5 * shortest_s / machine.sample_period_s * (1 + 1e-4)), 1).astype(np.int64)


def _longer(tasks: Tasks, samples: IntArray, excess: FloatArray, sample_period_s: float, share: float) -> IntArray:
    """Lengthen the stretches that break a limit by `share` of what certainly does; at least what breaks it grows."""
    segments = stretches(tasks, excess > 0)
    given = samples[segments]
    enough = sufficient_samples((tasks[0][segments], tasks[1][segments]), given, sample_period_s)
    longer = samples.copy()
    longer[segments] = given + 2 * np.ceil(0.5 * share * (enough - given)).astype(np.int64)
    return longer


def _tasks(counted: CountedPath, machine: MachineDescription, time_s: FloatArray) -> Tasks:
    def task(letter: str, axis: Axis) -> AxisTask:
        step_mm_s = 1 / axis.counts_per_mm
        # Rounding towards zero moves a velocity by up to a count/s, an acceleration by up to six of them over h.
        move_counts = np.diff(counted.position_counts[letter])
        return AxisTask(
            move_counts / axis.signed_counts_per_mm,
            axis.v_max_mm_s - 2 * step_mm_s,
            axis.a_max_mm_s2 - 6 * step_mm_s / time_s,
            step_mm_s,
            free_nodes(move_counts),
        )

    x, y = (machine.letter_of(coordinate) for coordinate in ("x", "y"))
    return task(x, machine.axis_of("x")), task(y, machine.axis_of("y"))


def _program(
    counted: CountedPath, velocities: tuple[FloatArray, FloatArray], machine: MachineDescription
) -> PvtProgram:
    axes = {}
    coordinates = {coordinate: machine.letter_of(coordinate) for coordinate in ("x", "y")}
    for coordinate, velocity_mm_s in zip(("x", "y"), velocities, strict=True):
        letter, axis = coordinates[coordinate], machine.axis_of(coordinate)
        position = counted.position_counts[letter]
        axes[letter] = AxisProgram(
            np.diff(position),
            np.trunc(velocity_mm_s[1:] * axis.signed_counts_per_mm).astype(np.int64),
            int(position[0]),
            axis.signed_counts_per_mm,
        )
    return PvtProgram(dict(sorted(axes.items())), coordinates, counted.time_samples, machine.sample_period_s)


def _check_times(dwell_s: FloatArray, path: ToolPath) -> None:
    if dwell_s.shape != (path.segments,):
        raise SolverError(f"schedule: {path.segments} segments but {dwell_s.size} times", "give one time per segment")
    bad = ~(np.isfinite(dwell_s) & (dwell_s >= 0))
    if bad.any():
        node = int(np.argmax(bad)) + 1
        raise LimitsError(
            f"schedule: dwell time at node {node} is {dwell_s[node - 1]:g} s", "times must be finite and not negative"
        )


def _times_too_short(
    path: ToolPath, counted: CountedPath, asked: IntArray, needed: IntArray, sample_period_s: float
) -> LimitsError:
    missing_s = np.bincount(counted.source_segment, (needed - asked) * sample_period_s, minlength=path.segments)
    worst = np.argsort(-missing_s, kind="stable")[:5]
    named = ", ".join(
        f"node {segment + 1} ({path.x_mm[segment + 1]:.3f}, {path.y_mm[segment + 1]:.3f} mm) +{missing_s[segment]:.4f} s"
        for segment in worst
        if missing_s[segment] > 0
    )
    count = int((missing_s > 0).sum())
    return LimitsError(
        f"schedule: the limits cannot be met in the given times: {count} nodes need more, the worst: {named}",
        f"lengthen these dwell times ({missing_s.sum():.3f} s in all) or raise v_max_mm_s or a_max_mm_s2",
    )
