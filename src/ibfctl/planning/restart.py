"""The rest of a program, taken up from rest with the gate open: its own motion, but for a short ramp at the begin.

In the ramp plan time passes at the rate 3 u² - 2 u³ of the ramp's own time u = 0 .. 1: the tool stays on the path, and
half of the ramp's duration is added to the dwell along it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.machine.program import AxisProgram, IntArray, PvtProgram
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.job import corridor_of
from ibfctl.planning.plan import Plan
from ibfctl.planning.rounding import rounded
from ibfctl.schedule.certificate import axis_cubics, certify
from ibfctl.schedule.hermite import Cubics
from ibfctl.schedule.scheduler import PvtSchedule

FloatArray = NDArray[np.float64]

_PIECES = 4
_SHORTEST_SAMPLES = 8
_LENGTHENING = 1.5
_TRIES = 16
# Less than this is as good as the end.
_LEAST_S = 0.05


def places(program: PvtProgram, samples: FloatArray) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Positions in counts and velocities in counts/s (n,) of every axis at times `samples` (n,) since the begin."""
    ends = np.cumsum(program.time_samples)
    segment = np.minimum(np.searchsorted(ends, samples, side="right"), len(program) - 1)
    tau_s = (samples - ends[segment] + program.time_samples[segment]) * program.sample_period_s
    found = {}
    for letter, axis in program.axes.items():
        cubics = axis_cubics(program, axis)
        parts = (cubics.start, cubics.move, cubics.start_velocity, cubics.end_velocity, cubics.time_s)
        chosen = Cubics(*(part[segment] for part in parts))
        found[letter] = chosen.position(tau_s), chosen.velocity(tau_s)
    return found


def node_samples(program: PvtProgram, path: ToolPath) -> IntArray:
    """When a program reaches each node (n + 1,) of its path on the machine, in samples since its begin.

    A node of the program that is none of the path is where a long segment was split.

    Raises
    ------
    InputError
        If the program is not one of this path.
    """
    wanted, reached = [], []
    for coordinate, nodes_mm in (("x", path.x_mm), ("y", path.y_mm)):
        axis = program.axis_of(coordinate)
        wanted.append(nodes_mm * axis.counts_per_mm)
        reached.append(axis.start_counts + np.concatenate([[0], np.cumsum(axis.increment_counts)]))
    nodes = list(zip(*wanted, strict=True))
    found: list[int] = []
    elapsed = np.concatenate([[0], np.cumsum(program.time_samples)]).tolist()
    for x, y, sample in zip(*reached, elapsed, strict=True):
        if len(found) < len(nodes) and max(abs(nodes[len(found)][0] - x), abs(nodes[len(found)][1] - y)) <= 1:
            found.append(sample)
    if len(found) < len(nodes):
        raise InputError("re-planning: path and program of the plan differ", "plan the part that is left anew")
    return np.array(found)


def restart(plan: Plan, seam: float, corridor_mm: float) -> tuple[ToolPath, PvtSchedule | None]:
    """Return the rest of a plan's path from `seam` (samples since its begin) on, and its program from rest there.

    Returns
    -------
    path, schedule
        The schedule is None where no short ramp keeps the limits.

    Raises
    ------
    InputError
        If nothing is left.
    """
    fastest_s = 0.0
    for letter, (_, velocity) in places(plan.program, np.array([seam])).items():
        limits = plan.machine.axes[letter]  # type: ignore[index]
        fastest_s = max(fastest_s, float(abs(velocity[0])) / limits.counts_per_mm / limits.a_max_mm_s2)
    half = max(_LENGTHENING * fastest_s / plan.program.sample_period_s / 2, _PIECES * _SHORTEST_SAMPLES / 2)
    stage_path = walked_path(plan)
    nodes = node_samples(plan.program, stage_path)
    for _ in range(_TRIES):
        joined = 2 * int(np.ceil((seam + half) / 2))
        # A short piece up to the next node would be all rounding.
        following = int(nodes[np.searchsorted(nodes, joined - 1, side="right")]) if joined <= nodes[-1] else joined
        if 0 < following - joined < _SHORTEST_SAMPLES:
            joined = following
        if joined > nodes[-1]:
            break
        path, scheduled = _joined(plan, seam, joined, stage_path, nodes, corridor_mm)
        if scheduled.certificate.passed:
            return _on_part(path, plan), scheduled
        half *= _LENGTHENING
    ahead = int(np.searchsorted(nodes, seam, side="right"))
    if (nodes[-1] - seam) * plan.program.sample_period_s < _LEAST_S:
        raise InputError("re-planning: nothing of the path is left", "the run was executed to its end")
    found = places(plan.program, np.array([seam]))
    x_mm, y_mm = (
        found[letter][0] / plan.program.axes[letter].counts_per_mm
        for letter in (plan.program.coordinates["x"], plan.program.coordinates["y"])
    )
    path = ToolPath(np.append(x_mm, stage_path.x_mm[ahead:]), np.append(y_mm, stage_path.y_mm[ahead:]))
    return _on_part(path, plan), None


def walked_path(plan: Plan) -> ToolPath:
    """Return the path on the machine whose nodes a plan's program passes: through rounded corners, where they are."""
    path = ToolPath(*plan.options.placement(plan.path.x_mm, plan.path.y_mm))
    tolerance_mm = plan.options.corner_tolerance_mm
    if tolerance_mm is None:
        return path
    return rounded(path, plan.machine, tolerance_mm, corridor_of(plan.options)).smoothed.pieces


def _on_part(path: ToolPath, plan: Plan) -> ToolPath:
    return ToolPath(*plan.options.placement.inverse(path.x_mm, path.y_mm))


def _joined(
    plan: Plan, seam: float, joined: int, stage_path: ToolPath, nodes: IntArray, corridor_mm: float
) -> tuple[ToolPath, PvtSchedule]:
    """Make the ramp up to the even sample `joined`, and the rest of the program."""
    program = plan.program
    ends = np.cumsum(program.time_samples)
    rest = int(np.searchsorted(ends, joined, side="right"))
    # The ramp's even samples, what of plan time is behind at them, and how fast it passes.
    length = 2 * int(np.ceil(joined - seam))
    ramp = 2 * np.rint(np.linspace(0, length, _PIECES + 1) / 2)
    u = ramp / length
    plan_samples = seam + 2 * (joined - seam) * (u**3 - u**4 / 2)
    times = np.concatenate([np.diff(ramp).astype(np.int64), program.time_samples[rest:]])
    if rest < len(program):
        times[_PIECES] = ends[rest] - joined
    found = places(program, plan_samples)
    axes = {}
    for letter, axis in program.axes.items():
        position = np.concatenate(
            [np.rint(found[letter][0]).astype(np.int64), (axis.start_counts + np.cumsum(axis.increment_counts))[rest:]]
        )
        velocity = np.concatenate([found[letter][1] * (3 * u**2 - 2 * u**3), axis.end_velocity_counts_s[rest:]])
        moves = np.diff(position)
        velocity[: _PIECES + 1] = _without_reversal(velocity, moves, times * program.sample_period_s)[: _PIECES + 1]
        axes[letter] = AxisProgram(moves, np.rint(velocity[1:]).astype(np.int64), int(position[0]), axis.counts_per_mm)
    made = replace(program, axes=axes, time_samples=times)
    ahead = int(np.searchsorted(nodes, joined, side="right"))
    path = ToolPath(
        *(
            np.append(_ends_mm(made.axis_of(coordinate), _PIECES), nodes_mm[ahead:])
            for coordinate, nodes_mm in (("x", stage_path.x_mm), ("y", stage_path.y_mm))
        )
    )
    source = np.append(np.zeros(_PIECES, dtype=np.int64), 1 + np.searchsorted(nodes[ahead:], ends[rest:]))
    time_s = np.bincount(source, made.time_s, minlength=path.segments).astype(np.float64)
    certificate = certify(made, plan.machine, path, time_s, source, corridor_mm)
    return path, PvtSchedule(made, certificate, time_s, source)


def _without_reversal(velocity: FloatArray, moves: IntArray, time_s: FloatArray) -> FloatArray:
    """Velocities (n + 1,), as large as cubics through rounded positions allow that never turn back.

    A cubic is monotone where the velocities at its ends are at most three times its mean (Fritsch and Carlson 1980,
    SIAM J. Numer. Anal. 17).
    """
    mean = moves / time_s
    least = np.zeros(velocity.size)
    least[1:-1] = np.where(mean[1:] * mean[:-1] > 0, np.minimum(np.abs(mean[1:]), np.abs(mean[:-1])), 0.0)
    limit = np.floor(3 * least)
    return np.clip(velocity, -limit, limit)


def _ends_mm(axis: AxisProgram, segments: int) -> FloatArray:
    """Begin of a program, and the end of its first segments, in mm."""
    counts = axis.start_counts + np.array([0, int(axis.increment_counts[:segments].sum())])
    return counts / axis.counts_per_mm
