"""Schedules of smoothed paths: within the limits and the tolerance, in the times asked for, and gentler than stops."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.errors import SolverError
from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.path.figures import distances_mm
from ibfctl.path.maze import maze
from ibfctl.path.smoothing_pieces import SmoothedPath, smoothed_path
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule import smoothed as smoothed_module
from ibfctl.schedule.certificate import axis_cubics
from ibfctl.schedule.hermite import Cubics
from ibfctl.schedule.scheduler import PvtSchedule, schedule, shortest_times, with_jerk_limit
from ibfctl.schedule.smoothed import balanced, schedule_smoothed
from ibfctl.surface.map import Rectangle

TOLERANCE_MM = 0.025
CORRIDOR_MM = TOLERANCE_MM
PATH = maze(Rectangle(0, 4, 0, 3), 0.5, seed=2)


@pytest.fixture(scope="module")
def machine() -> MachineDescription:
    return read_machine(shipped_machine("nsls2-ibf"))


def rounded(path: ToolPath, tolerance_mm: float = TOLERANCE_MM) -> SmoothedPath:
    return smoothed_path(path, tolerance_mm, tolerance_mm, rounding_mm=1e-4)


def cubics_mm(scheduled: PvtSchedule) -> dict[str, Cubics]:
    program, found = scheduled.program, {}
    for coordinate in ("x", "y"):
        axis = program.axis_of(coordinate)
        counts, scale = axis_cubics(program, axis), axis.counts_per_mm
        found[coordinate] = Cubics(
            counts.start / scale,
            counts.move / scale,
            counts.start_velocity / scale,
            counts.end_velocity / scale,
            counts.time_s,
        )
    return found


def peak_mm_s2(scheduled: PvtSchedule) -> float:
    return max(float(cubics.peak_acceleration.max()) for cubics in cubics_mm(scheduled).values())


def check(scheduled: PvtSchedule, name: str) -> float:
    return next(check.value for check in scheduled.certificate.checks if check.name == name)


def test_times_that_leave_room_are_kept_to_the_sample(machine: MachineDescription) -> None:
    dwell_s = 0.2 + 0.3 * np.random.default_rng(0).uniform(size=PATH.segments)
    smoothed = balanced(rounded(PATH), dwell_s, machine)
    scheduled = schedule_smoothed(smoothed, dwell_s, machine)
    assert scheduled.certificate.passed
    np.testing.assert_allclose(scheduled.segment_time_s, dwell_s, atol=2.1 * machine.sample_period_s)
    assert scheduled.program.total_time_s == pytest.approx(dwell_s.sum(), abs=2 * machine.sample_period_s)
    np.testing.assert_allclose(
        np.bincount(scheduled.source_segment, scheduled.program.time_s), scheduled.segment_time_s, atol=1e-9
    )


def test_the_tool_does_not_stop_at_corners(machine: MachineDescription) -> None:
    dwell_s = np.full(PATH.segments, 0.2)
    sharp = schedule(PATH, dwell_s, machine, CORRIDOR_MM)
    smooth = schedule_smoothed(balanced(rounded(PATH), dwell_s, machine), dwell_s, machine)
    slowest = []
    for scheduled in (sharp, smooth):
        tau = np.linspace(0, 1, 9) * scheduled.program.time_s[:, None]
        speed = np.hypot(*(cubics.velocity(tau) for cubics in cubics_mm(scheduled).values()))
        slowest.append(speed.ravel()[5:-5].min())
    assert slowest[0] == pytest.approx(0.0, abs=1e-9)
    assert slowest[1] > 0.2 * 0.5 / 0.2


def test_equal_times_are_walked_with_a_fraction_of_the_acceleration(machine: MachineDescription) -> None:
    dwell_s = np.full(PATH.segments, 0.2)
    sharp = schedule(PATH, dwell_s, machine, CORRIDOR_MM)
    limit = 0.7 * peak_mm_s2(sharp)
    smoothed = balanced(rounded(PATH), dwell_s, machine)
    smooth = schedule_smoothed(smoothed, dwell_s, machine, a_max_mm_s2=dict.fromkeys(machine.axes, limit))
    assert peak_mm_s2(smooth) <= limit
    # The segments that begin and end at rest cannot do that in their time; all others can.
    longer_s = smooth.segment_time_s - sharp.segment_time_s
    assert np.abs(longer_s[1:-1]).sum() <= 0.005 * sharp.program.total_time_s
    assert longer_s.sum() <= 0.02 * sharp.program.total_time_s
    # The certificate speaks of the machine's limits, not of the wish.
    checks = {check.name: check for check in smooth.certificate.checks}
    for letter, axis in machine.axes.items():
        assert checks[f"peak_acceleration_mm_s2.{letter}"].limit == axis.a_max_mm_s2


def test_what_the_limits_do_not_allow_takes_longer(machine: MachineDescription) -> None:
    dwell_s = 0.5 * shortest_times(PATH, machine)
    scheduled = schedule_smoothed(balanced(rounded(PATH), dwell_s, machine), dwell_s, machine)
    assert scheduled.certificate.passed
    assert (scheduled.segment_time_s >= dwell_s - 2.1 * machine.sample_period_s).all()
    assert scheduled.program.total_time_s > 1.1 * dwell_s.sum()


def test_a_limit_of_the_jerk_is_kept(machine: MachineDescription) -> None:
    dwell_s = np.full(PATH.segments, 0.25)
    smoothed = balanced(rounded(PATH), dwell_s, machine)
    free = schedule_smoothed(smoothed, dwell_s, machine)
    limit = 0.5 * max(np.abs(cubics.jerk).max() for cubics in cubics_mm(free).values())
    stages = with_jerk_limit(machine, limit)
    limited = schedule_smoothed(balanced(rounded(PATH), dwell_s, stages), dwell_s, stages)
    assert limited.certificate.passed
    assert max(np.abs(cubics.jerk).max() for cubics in cubics_mm(limited).values()) <= limit


def test_balancing_lowers_the_highest_acceleration(machine: MachineDescription) -> None:
    dwell_s = 0.15 * np.random.default_rng(5).lognormal(0.0, 0.5, PATH.segments)
    raw, better = rounded(PATH), balanced(rounded(PATH), dwell_s, machine)
    np.testing.assert_allclose(better.sums(better.share), 1.0)
    peaks = [peak_mm_s2(schedule_smoothed(each, dwell_s, machine)) for each in (raw, better)]
    assert peaks[1] < 0.9 * peaks[0]


def walk(random: np.random.Generator, kind: str) -> ToolPath:
    if kind == "slanted":
        return ToolPath(*np.cumsum(0.5 * random.normal(size=(2, 25)), axis=1))
    if kind == "grid":  # turns right back, repeated nodes
        return ToolPath(*np.cumsum(0.5 * random.integers(-1, 2, (2, 25)), axis=1))
    heading = np.cumsum(random.choice([-1, 0, 1], 25)) * np.pi / 3
    return ToolPath(*np.cumsum(0.5 * np.stack([np.cos(heading), np.sin(heading)]), axis=1))


@settings(deadline=None, max_examples=25)
@given(
    st.sampled_from(["slanted", "grid", "hexagons"]), st.integers(0, 10_000), st.sampled_from([0.01, 0.025, 0.2]),
    st.sampled_from([0.03, 0.1, 0.5]),
)  # fmt: skip
def test_no_path_leaves_its_tolerance_or_its_limits(kind: str, seed: int, tolerance_mm: float, time_s: float) -> None:
    machine = read_machine(shipped_machine("nsls2-ibf"))
    random = np.random.default_rng(seed)
    path = walk(random, kind)
    dwell_s = time_s * random.lognormal(0.0, 0.5, path.segments)
    smoothed = balanced(rounded(path, tolerance_mm), dwell_s, machine)
    scheduled = schedule_smoothed(smoothed, dwell_s, machine)
    assert scheduled.certificate.passed
    # The certificate's bound against the motion itself.
    cubics = cubics_mm(scheduled)
    tau = np.linspace(0, 1, 17) * scheduled.program.time_s[:, None]
    at = np.stack([cubics[coordinate].position(tau) for coordinate in ("x", "y")], axis=-1)
    programmed = np.column_stack([path.x_mm, path.y_mm])
    starts, moves = programmed[scheduled.source_segment], np.diff(programmed, axis=0)[scheduled.source_segment]
    seen = max(distances_mm(at[:, place], starts, moves).max() for place in range(17))
    corners = np.hypot(*(at.reshape(-1, 2)[:, None] - programmed).transpose(2, 0, 1)).min(axis=0).max()
    assert max(seen, corners) <= check(scheduled, "deviation_mm") + 1e-9
    assert check(scheduled, "deviation_mm") <= tolerance_mm


def test_a_motion_outside_the_tolerance_is_refused(
    machine: MachineDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(smoothed_module, "_deviation_mm", lambda *arguments: 1.01 * TOLERANCE_MM)
    with pytest.raises(SolverError, match="corner tolerance"):
        schedule_smoothed(rounded(PATH), np.full(PATH.segments, 0.2), machine)
