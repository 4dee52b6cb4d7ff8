"""The optional limit of the jerk: held inside every segment, certified, and paid for in time where it must be."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.errors import InputError, LimitsError
from ibfctl.machine.description import MachineDescription
from ibfctl.path.maze import maze
from ibfctl.path.raster import raster
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.certificate import axis_cubics
from ibfctl.schedule.scheduler import PvtSchedule, schedule, shortest_times
from ibfctl.surface.map import Rectangle
from tests.property.timed_paths import make_machine

CORRIDOR_MM = 0.025
AREA = Rectangle(-2.0, 2.0, -1.5, 1.5)


def limited(machine: MachineDescription, jerk_mm_s3: float) -> MachineDescription:
    axes = {letter: axis.model_copy(update={"j_max_mm_s3": jerk_mm_s3}) for letter, axis in machine.axes.items()}
    return machine.model_copy(update={"axes": axes})


def peak_jerk(scheduled: PvtSchedule) -> float:
    """Largest jerk in mm/s³, from differences of the acceleration at both ends of every cubic."""
    peaks = []
    for axis in scheduled.program.axes.values():
        cubics = axis_cubics(scheduled.program, axis)
        change = cubics.end_acceleration - cubics.start_acceleration
        peaks.append(np.abs(change / cubics.time_s).max() / abs(axis.counts_per_mm))
    return float(max(peaks))


@pytest.mark.parametrize("path", [maze(AREA, 0.5, 3), raster(AREA, 0.5, 0.25)], ids=["maze", "raster"])
@pytest.mark.parametrize("jerk_mm_s3", [2e2, 5e3, 2e5])
def test_a_limited_jerk_is_held_and_certified(path: ToolPath, jerk_mm_s3: float) -> None:
    random = np.random.default_rng(1)
    dwell_s = random.uniform(0.05, 0.15, path.segments)
    machine = make_machine()
    scheduled = schedule(path, dwell_s, machine, CORRIDOR_MM, stretch=True, jerk_max_mm_s3=jerk_mm_s3)
    checks = {check.name: check for check in scheduled.certificate.checks}
    for letter in "AB":
        assert checks[f"peak_jerk_mm_s3.{letter}"].passed
        assert checks[f"peak_jerk_mm_s3.{letter}"].limit == jerk_mm_s3
    assert peak_jerk(scheduled) <= jerk_mm_s3 * (1 + 1e-9)
    free = schedule(path, dwell_s, machine, CORRIDOR_MM, stretch=True)
    assert not any(check.name.startswith("peak_jerk") for check in free.certificate.checks)
    if peak_jerk(free) <= jerk_mm_s3:
        assert scheduled.program.total_time_s == free.program.total_time_s
    else:
        assert scheduled.program.total_time_s >= free.program.total_time_s


def test_a_looser_limit_than_the_free_schedule_changes_nothing() -> None:
    path = maze(AREA, 0.5, 3)
    dwell_s = np.full(path.segments, 0.1)
    free = schedule(path, dwell_s, make_machine(), CORRIDOR_MM)
    bound = schedule(path, dwell_s, make_machine(), CORRIDOR_MM, jerk_max_mm_s3=1.01 * peak_jerk(free))
    for letter, axis in free.program.axes.items():
        np.testing.assert_array_equal(
            axis.end_velocity_counts_s, bound.program.axes[letter].end_velocity_counts_s
        )


def test_a_limit_just_below_the_free_schedule_is_met_in_the_same_time() -> None:
    path = ToolPath(0.5 * np.arange(9.0), np.zeros(9))
    dwell_s = np.array([0.4, 0.1, 0.1, 0.15, 0.3, 0.1, 0.1, 0.4])
    free = schedule(path, dwell_s, make_machine(), CORRIDOR_MM)
    limit = 0.9 * peak_jerk(free)
    bound = schedule(path, dwell_s, make_machine(), CORRIDOR_MM, jerk_max_mm_s3=limit)
    assert bound.program.total_time_s == free.program.total_time_s
    assert 0.9 * limit < peak_jerk(bound) <= limit


def test_from_rest_to_rest_it_takes_the_cube_root_of_twelve_moves_over_the_jerk() -> None:
    path = ToolPath(np.array([0.0, 3.0]), np.zeros(2))
    shortest_s = (12 * 3.0 / 500.0) ** (1 / 3)
    machine = make_machine()
    (needed_s,) = shortest_times(path, limited(machine, 500.0))
    assert shortest_s <= needed_s <= 1.01 * shortest_s + 2 / 1024
    with pytest.raises(LimitsError, match="node 1"):
        schedule(path, np.array([0.9 * shortest_s]), machine, CORRIDOR_MM, jerk_max_mm_s3=500.0)
    stretched = schedule(path, np.array([0.0]), machine, CORRIDOR_MM, stretch=True, jerk_max_mm_s3=500.0)
    assert shortest_s <= stretched.program.total_time_s <= 1.01 * shortest_s + 2 / 1024


@pytest.mark.parametrize("path", [maze(AREA, 0.5, 3), raster(AREA, 0.5, 0.25)], ids=["maze", "raster"])
@pytest.mark.parametrize("jerk_mm_s3", [2e2, 5e3, 2e5])
def test_the_shortest_times_hold_the_limit_of_the_machine(path: ToolPath, jerk_mm_s3: float) -> None:
    machine = limited(make_machine(), jerk_mm_s3)
    shortest_s = shortest_times(path, machine)
    assert (shortest_s >= shortest_times(path, make_machine())).all()
    scheduled = schedule(path, shortest_s, machine, CORRIDOR_MM)
    assert scheduled.certificate.passed
    assert scheduled.program.total_time_s == pytest.approx(shortest_s.sum())


def test_the_tighter_of_two_limits_counts() -> None:
    path = ToolPath(np.array([0.0, 3.0]), np.zeros(2))
    for own, given in ((500.0, 9e9), (9e9, 500.0)):
        scheduled = schedule(
            path, np.zeros(1), limited(make_machine(), own), CORRIDOR_MM, stretch=True, jerk_max_mm_s3=given
        )
        assert peak_jerk(scheduled) <= 500.0


@pytest.mark.parametrize("jerk_mm_s3", [0.0, -1.0, float("nan"), float("inf")])
def test_a_limit_that_is_none_is_refused(jerk_mm_s3: float) -> None:
    path = ToolPath(np.array([0.0, 3.0]), np.zeros(2))
    with pytest.raises(InputError, match="jerk"):
        schedule(path, np.ones(1), make_machine(), CORRIDOR_MM, jerk_max_mm_s3=jerk_mm_s3)


def test_a_limit_too_low_for_one_count_is_refused() -> None:
    machine = make_machine(counts_per_mm=(30.0, 30.0), a_max_mm_s2=(5.0, 5.0), sample_period_s=1 / 4096)
    path = ToolPath(np.array([0.0, 1 / 30, 0.0]), np.zeros(3))  # one count there, one back
    with pytest.raises(LimitsError, match="too low for its counts"):
        schedule(path, np.full(2, 1.0), machine, 0.025, stretch=True, jerk_max_mm_s3=1.6)
