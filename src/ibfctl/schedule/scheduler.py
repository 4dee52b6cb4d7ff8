"""From a timed path to a certified program of integers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError, LimitsError, SolverError
from ibfctl.machine.description import Axis, MachineDescription
from ibfctl.machine.program import (
    MAX_SEGMENT_SAMPLES,
    MAX_VELOCITY_COUNTS_S,
    AxisProgram,
    IntArray,
    PvtProgram,
    seconds,
)
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.certificate import Certificate, certify
from ibfctl.schedule.counting import MAX_SEGMENTS, CountedPath, count_path, even_samples
from ibfctl.schedule.stretching import sufficient_samples
from ibfctl.schedule.task import AxisTask, Tasks, free_nodes, stretches
from ibfctl.schedule.velocity import Known, solve_velocities

FloatArray = NDArray[np.float64]

# Parts of the way to times that certainly do, tried one after the other where the wanted times break a limit; beyond
# one, the axes rest at every node of a stretch that still does (a corridor finer than a step of the velocities).
_SHARES = (0.2, 0.4, 0.6, 0.8, 1.0, 1.0, 2.0, 2.0, 2.0)


# Each round splits what was too long; long steps of a slow machine settle in some thousands at the very most.
_COUNTING_ROUNDS = 10_000


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
    path: ToolPath,
    dwell_s: FloatArray,
    machine: MachineDescription,
    corridor_mm: float | FloatArray,
    *,
    stretch: bool = False,
    jerk_max_mm_s3: float | None = None,
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
        How far the motion may leave the straight line between two nodes; one, or (n,).
    stretch
        Lengthen the times of segments that the limits do not allow, instead of refusing.
    jerk_max_mm_s3
        Limit of the jerk inside segments, for both axes, beside those of the machine.

    Raises
    ------
    InputError
        If there are not as many times as segments, or the limit of the jerk is no positive number.
    LimitsError
        If the limits cannot be met in the given times (without `stretch`), with the nodes that need more time;
        or if the path leaves the travel of an axis.
    SolverError
        If no velocities pass the certificate.
    """
    _check_times(dwell_s, path, machine.sample_period_s)
    if jerk_max_mm_s3 is not None:
        machine = with_jerk_limit(machine, jerk_max_mm_s3)
    corridor_mm = np.broadcast_to(corridor_mm, (path.segments,))
    asked = needed = even_samples(dwell_s, machine.sample_period_s)
    at_rest = np.zeros(path.segments, dtype=bool)
    known: Known | None = None
    enough = False
    for share in _SHARES:
        counted = counted_path(path, needed, machine, at_rest)
        needed = _per_segment(counted, counted.time_samples, path)
        time_s = seconds(counted.time_samples, machine.sample_period_s)
        tasks = axis_tasks(counted, machine, at_rest)
        corridor = corridor_mm[counted.source_segment]
        solution = solve_velocities(tasks, time_s, corridor, last_resort=enough or share >= 1, known=known)
        if not solution.excess.any():
            break
        known = Known(tasks, time_s, solution)
        broken = stretches(tasks, solution.excess > 0)
        if share > 1:
            at_rest[counted.source_segment[broken]] = True
        longer = _longer(tasks, counted.time_samples, broken, machine.sample_period_s, min(share, 1.0))
        enough = np.array_equal(longer, counted.time_samples)
        needed = _per_segment(counted, longer, path)
    else:
        raise SolverError(
            f"schedule: limits still exceeded by {solution.excess.max():.2%} in times that should do",
            "use longer dwell times or a wider corridor",
        )
    if not stretch and (needed > asked).any():
        raise _times_too_short(path, seconds(needed - asked, machine.sample_period_s))
    program = _program(counted, solution.velocity_mm_s, machine)
    time_s = dwell_s + seconds(needed - asked, machine.sample_period_s)
    certificate = certify(program, machine, path, time_s, counted.source_segment, corridor)
    if not certificate.passed:
        failed = next(check for check in certificate.checks if not check.passed)
        raise SolverError(
            f"schedule: certificate fails at {failed.name}: {failed.value:.6g} over the limit of {failed.limit:.6g}",
            "this is a defect of the scheduler: keep the input files and report it",
        )
    return PvtSchedule(program, certificate, seconds(needed, machine.sample_period_s), counted.source_segment)


def shortest_times(path: ToolPath, machine: MachineDescription) -> FloatArray:
    """Times (n,) of the fastest motion along the path that certainly keeps the limits: lower bounds for dwell times.

    Whole numbers of sample pairs, in seconds: rounding the running sum of longer times never falls below them.
    """
    free = np.zeros(path.segments, dtype=bool)
    counted = counted_path(path, np.zeros(path.segments, dtype=np.int64), machine, free)
    tasks = axis_tasks(counted, machine, free)
    sufficient = sufficient_samples(tasks, counted.time_samples, machine.sample_period_s)
    return seconds(_per_segment(counted, sufficient, path), machine.sample_period_s)


def _shortest_samples(tasks: Tasks, sample_period_s: float) -> IntArray:
    """Even samples (n,) below which a segment breaks a limit whatever its neighbours do.

    From rest to rest a cubic needs time sqrt(6 s/a) and reaches 1.5 times its mean speed; with one end at
    rest sqrt(2 s/a); between moving ends only the speed limit counts. A limit j of the jerk asks for
    cbrt(12 s/j) from rest to rest, and for nothing where an end may move.
    """
    shortest_s = np.zeros(tasks[0].move_mm.size)
    for task in tasks:
        move_mm = np.abs(task.move_mm)
        ends_at_rest = 2 - task.free[:-1].astype(int) - task.free[1:].astype(int)
        speed = np.choose(ends_at_rest, [1.0, 1.0, 1.5]) * move_mm / task.v_max_mm_s
        push = np.sqrt(np.choose(ends_at_rest, [0.0, 2.0, 6.0]) * move_mm / task.a_max_mm_s2)
        turn = np.cbrt(np.choose(ends_at_rest, [0.0, 0.0, 12.0]) * move_mm / task.j_max_mm_s3)
        shortest_s = np.maximum(shortest_s, np.maximum(np.maximum(speed, push), turn))
    return 2 * np.maximum(np.ceil(0.5 * shortest_s / sample_period_s * (1 + 1e-9)), 1).astype(np.int64)


def counted_path(
    path: ToolPath, samples: IntArray, machine: MachineDescription, at_rest: NDArray[np.bool_]
) -> CountedPath:
    """Count a path whose segments take `samples` (n,), or the shortest time of each piece where that is longer.

    Raises
    ------
    LimitsError
        If the limits are so low that even a piece of one count takes longer than a segment may.
    """
    for _ in range(_COUNTING_ROUNDS):
        counted = count_path(path, samples, machine)
        shortest = _shortest_samples(axis_tasks(counted, machine, at_rest), machine.sample_period_s)
        enough = np.maximum(counted.time_samples, shortest)
        if enough.max() <= MAX_SEGMENT_SAMPLES:
            return replace(counted, time_samples=enough)
        # Too long for one piece: count again, in more pieces.
        samples = _per_segment(counted, enough, path)
    longest_s = MAX_SEGMENT_SAMPLES * machine.sample_period_s
    raise LimitsError(
        f"schedule: the machine's limits are too low for its counts: moving by one takes longer than {longest_s:.3g} s",
        "check counts_per_mm, a_max_mm_s2 and j_max_mm_s3 in the machine file",
    )


def _per_segment(counted: CountedPath, samples: IntArray, path: ToolPath) -> IntArray:
    """Samples of each segment of the path (n,) from those of its pieces."""
    total = np.zeros(path.segments, dtype=np.int64)
    np.add.at(total, counted.source_segment, samples)
    return total


def _longer(tasks: Tasks, samples: IntArray, segments: IntArray, sample_period_s: float, share: float) -> IntArray:
    """Lengthen the pieces `segments` by `share` of what certainly does."""
    given = samples[segments]
    enough = sufficient_samples((tasks[0][segments], tasks[1][segments]), given, sample_period_s)
    longer = samples.copy()
    longer[segments] = given + 2 * np.ceil(0.5 * share * (enough - given)).astype(np.int64)
    return longer


def axis_tasks(counted: CountedPath, machine: MachineDescription, at_rest: NDArray[np.bool_]) -> Tasks:
    """What the axes have to do; they rest at the nodes of the path's segments `at_rest` (n,)."""
    resting = at_rest[counted.source_segment]
    moving = np.ones(resting.size + 1, dtype=bool)
    moving[:-1] &= ~resting
    moving[1:] &= ~resting

    def task(letter: str, axis: Axis) -> AxisTask:
        move_counts = np.diff(counted.position_counts[letter])
        return AxisTask(
            move_counts / axis.signed_counts_per_mm,
            min(axis.v_max_mm_s, MAX_VELOCITY_COUNTS_S / axis.counts_per_mm),
            axis.a_max_mm_s2,
            1 / axis.counts_per_mm,
            free_nodes(move_counts) & moving,
            np.inf if axis.j_max_mm_s3 is None else axis.j_max_mm_s3,
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
            np.rint(velocity_mm_s[1:] * axis.signed_counts_per_mm).astype(np.int64),
            int(position[0]),
            axis.signed_counts_per_mm,
        )
    return PvtProgram(dict(sorted(axes.items())), coordinates, counted.time_samples, machine.sample_period_s)


def with_jerk_limit(machine: MachineDescription, jerk_max_mm_s3: float) -> MachineDescription:
    """Return the machine with no axis' jerk above the limit."""
    if not (np.isfinite(jerk_max_mm_s3) and jerk_max_mm_s3 > 0):
        raise InputError(f"schedule: limit of the jerk is {jerk_max_mm_s3:g} mm/s³", "give a positive number")
    axes = {
        letter: axis.model_copy(update={"j_max_mm_s3": min(jerk_max_mm_s3, axis.j_max_mm_s3 or np.inf)})
        for letter, axis in machine.axes.items()
    }
    return machine.model_copy(update={"axes": axes})


def _check_times(dwell_s: FloatArray, path: ToolPath, sample_period_s: float) -> None:
    if dwell_s.shape != (path.segments,):
        raise InputError(f"schedule: {path.segments} segments but {dwell_s.size} times", "give one time per segment")
    longest_s = MAX_SEGMENTS * MAX_SEGMENT_SAMPLES * sample_period_s
    bad = ~((dwell_s >= 0) & (dwell_s <= longest_s))
    if bad.any():
        node = int(np.argmax(bad)) + 1
        raise LimitsError(
            f"schedule: dwell time at node {node} is {dwell_s[node - 1]:g} s",
            f"times must lie between 0 and {longest_s:.3g} s; ask for less removal or a lower --dwell-min-s",
        )


def _times_too_short(path: ToolPath, missing_s: FloatArray) -> LimitsError:
    worst = np.argsort(-missing_s, kind="stable")[:5]
    named = ", ".join(
        f"node {node} ({path.x_mm[node]:.3f}, {path.y_mm[node]:.3f} mm) +{missing_s[node - 1]:.4f} s"
        for node in worst + 1
        if missing_s[node - 1] > 0
    )
    return LimitsError(
        f"schedule: the limits cannot be met in the given times: {int((missing_s > 0).sum())} nodes need more, "
        f"the worst: {named}",
        f"lengthen these dwell times ({missing_s[missing_s > 0].sum():.3f} s in all), or raise the machine's limits",
    )
