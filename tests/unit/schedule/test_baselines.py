"""The baselines move as their papers say, and are measured by figures that hold against plain sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from ibfctl.path.maze import maze
from ibfctl.path.raster import raster
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.baselines.constant_acceleration import Move, accelerate, constant_acceleration
from ibfctl.schedule.baselines.motion import AxisMotion, Motion, motion_of_schedule
from ibfctl.schedule.baselines.position_mode import position_mode
from ibfctl.schedule.scheduler import schedule
from ibfctl.surface.map import Rectangle
from tests.property.timed_paths import make_machine

PAPER_STAGES = make_machine()
AREA = Rectangle(-3.0, 3.0, -2.0, 2.0)
MAZE = maze(AREA, 0.5, seed=1)


def dwell_of(path: ToolPath, mean_s: float = 0.1) -> np.ndarray:
    return mean_s * (1 + 0.5 * np.sin(path.dwell_x_mm) * np.cos(2 * path.dwell_y_mm))


def distance_of(move: Move, before: float) -> float:
    """Way of a move, integrated from its velocity."""
    ramp = quad(lambda t: before + move.acceleration_mm_s2 * t, 0, move.accelerating_s)[0]
    return float(ramp + move.velocity_mm_s * (move.time_s - move.accelerating_s))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("before", "move_mm", "time_s"), [(0, 0.5, 0.1), (8, 0.5, 0.1), (5, 0.5, 0.1), (5, 0, 0.1)])
def test_a_segment_is_done_in_its_time_and_ends_at_the_velocity_of_equations_5_and_6(
    sign: int, before: float, move_mm: float, time_s: float
) -> None:
    move = accelerate(sign * move_mm, time_s, sign * before, 250.0, 2000.0)
    assert move.time_s == time_s
    assert 0 <= move.accelerating_s <= time_s
    assert distance_of(move, sign * before) == pytest.approx(sign * move_mm, abs=1e-12)
    # Eq. 4 with the paper's sign of a: towards the mean velocity.
    v, a = move.velocity_mm_s, np.sign(sign * (move_mm / time_s - before)) * 2000.0
    residual = v**2 - 2 * (sign * before + a * time_s) * v + before**2 + 2 * a * sign * move_mm
    assert residual == pytest.approx(0.0, abs=1e-9)


def test_equation_7_takes_longer_where_the_acceleration_is_too_small() -> None:
    move = accelerate(0.5, 0.01, 0.0, 250.0, 2000.0)
    assert move.velocity_mm_s == pytest.approx(np.sqrt(2 * 2000 * 0.5))
    assert move.time_s == pytest.approx(np.sqrt(2000.0) / 2000) == pytest.approx(0.02236068)
    assert distance_of(move, 0.0) == pytest.approx(0.5)


def test_equation_7_arrives_early_where_the_brakes_are_too_weak() -> None:
    move = accelerate(0.5, 0.02, 100.0, 250.0, 2000.0)
    assert move.velocity_mm_s == pytest.approx(np.sqrt(100.0**2 - 2 * 2000 * 0.5))
    assert move.time_s < 0.02
    assert distance_of(move, 100.0) == pytest.approx(0.5)


def test_the_limit_of_velocity_is_enforced_and_the_way_still_done() -> None:
    move = accelerate(10.0, 0.5, 0.0, 15.0, 2000.0)
    assert move.velocity_mm_s == 15.0
    assert move.time_s > 0.5
    assert distance_of(move, 0.0) == pytest.approx(10.0)


def test_constant_acceleration_visits_every_node_in_time_and_overshoots_the_corners_of_a_maze() -> None:
    dwell_s = dwell_of(MAZE)
    motion = constant_acceleration(MAZE, dwell_s, PAPER_STAGES)
    when_s = np.concatenate([[0.0], np.cumsum(dwell_s)])
    np.testing.assert_allclose(motion.x.position(when_s), MAZE.x_mm, atol=1e-9)
    np.testing.assert_allclose(motion.y.position(when_s), MAZE.y_mm, atol=1e-9)
    assert motion.total_time_s == pytest.approx(dwell_s.sum())
    assert motion.overshoot_mm > 1e-3
    assert motion.peak_acceleration_mm_s2 == {"x": 2000.0, "y": 1000.0}


def test_axes_stay_on_one_clock_where_equation_7_changes_times() -> None:
    motion = constant_acceleration(MAZE, np.full(MAZE.segments, 0.015), PAPER_STAGES)
    assert motion.total_time_s > 0.015 * MAZE.segments
    assert motion.total_time_s == pytest.approx(motion.y.time_s.sum())
    ends = [np.bincount(axis.segment, axis.time_s) for axis in (motion.x, motion.y)]
    np.testing.assert_allclose(ends[0], ends[1])
    when_s = np.cumsum(ends[0])
    np.testing.assert_allclose(motion.x.position(when_s), MAZE.x_mm[1:], atol=1e-6)
    np.testing.assert_allclose(motion.y.position(when_s), MAZE.y_mm[1:], atol=1e-6)


def test_position_mode_rests_at_every_dwell_point_for_its_time() -> None:
    dwell_s = dwell_of(MAZE)
    motion = position_mode(MAZE, dwell_s, PAPER_STAGES)
    still = (motion.x.velocity_mm_s == 0) & (motion.x.acceleration_mm_s2 == 0)
    still &= (motion.y.velocity_mm_s == 0) & (motion.y.acceleration_mm_s2 == 0)
    np.testing.assert_array_equal(motion.x.segment[still], np.arange(MAZE.segments))
    np.testing.assert_allclose(motion.x.time_s[still], dwell_s)
    np.testing.assert_allclose(motion.x.position_mm[still], MAZE.dwell_x_mm)
    np.testing.assert_allclose(motion.y.position_mm[still], MAZE.dwell_y_mm)
    assert motion.total_time_s > dwell_s.sum()
    assert motion.overshoot_mm == 0.0
    assert motion.excursion_mm == 0.0


@pytest.mark.parametrize(("v_max", "time_s"), [(250.0, 2 * np.sqrt(10 / 2000)), (20.0, 20 / 2000 + 10 / 20)])
def test_a_move_of_position_mode_takes_the_least_time_within_the_limits(v_max: float, time_s: float) -> None:
    machine = make_machine(v_max_mm_s=(v_max, v_max))
    path = ToolPath(np.array([-5.0, 5.0, 15.0]), np.zeros(3))
    motion = position_mode(path, np.array([1.0, 2.0]), machine)
    assert motion.total_time_s == pytest.approx(3.0 + time_s)
    assert motion.x.peak_acceleration_mm_s2 == 2000.0
    assert np.abs(motion.x.velocity_mm_s).max() <= v_max


def test_a_slanted_move_of_position_mode_keeps_to_the_line_and_to_both_axes() -> None:
    path = ToolPath(np.array([0.0, 1.0, 3.0, 3.0]), np.array([0.0, 2.0, 5.0, 5.0]))
    motion = position_mode(path, np.full(3, 0.2), PAPER_STAGES)
    assert motion.excursion_mm == pytest.approx(0.0, abs=1e-9)
    assert motion.x.peak_acceleration_mm_s2 <= 2000.0
    assert motion.y.peak_acceleration_mm_s2 <= 1000.0 * (1 + 1e-12)


MOTIONS = {
    "pvt": lambda path, dwell_s: motion_of_schedule(schedule(path, dwell_s, PAPER_STAGES, 0.025, stretch=True)),
    "constant acceleration": lambda path, dwell_s: constant_acceleration(path, dwell_s, PAPER_STAGES),
    "position mode": lambda path, dwell_s: position_mode(path, dwell_s, PAPER_STAGES),
}


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("path", [MAZE, raster(AREA, 0.5, 1.0)], ids=["maze", "raster"])
def test_the_figures_of_a_motion_hold_against_plain_sampling(name: str, path: ToolPath) -> None:
    motion: Motion = MOTIONS[name](path, dwell_of(path, 0.05))
    x_mm, y_mm, time_s, segment = motion.samples()
    assert time_s.sum() == pytest.approx(motion.total_time_s)
    assert (np.diff(segment) >= 0).all()
    when_s = np.linspace(0, motion.total_time_s, 400_001)
    for axis, node_mm, sampled in ((motion.x, motion.path.x_mm, x_mm), (motion.y, motion.path.y_mm, y_mm)):
        places = axis.position(when_s)
        acceleration = np.gradient(np.gradient(places, when_s), when_s)
        assert np.abs(acceleration).max() == pytest.approx(axis.peak_acceleration_mm_s2, rel=2e-2)
        low, high = axis.position_range()
        assert low.min() == pytest.approx(places.min(), abs=1e-6)
        assert high.max() == pytest.approx(places.max(), abs=1e-6)
        # No leap of place or of velocity anywhere.
        assert np.abs(np.diff(places)).max() <= 1.01 * np.abs(np.gradient(places, when_s)).max() * when_s[1]
        mean = np.trapezoid(places, when_s) / motion.total_time_s
        assert (sampled * time_s).sum() / time_s.sum() == pytest.approx(mean, abs=1e-6)
        piece = np.searchsorted(axis.start_s[1:-1], when_s, side="right")
        first, last = node_mm[:-1][axis.segment[piece]], node_mm[1:][axis.segment[piece]]
        beyond = np.maximum(places - np.maximum(first, last), np.minimum(first, last) - places).max()
        assert beyond <= motion.overshoot_mm + 1e-6


def test_figures_of_a_motion_made_by_hand() -> None:
    # x goes to 1 mm, swings beyond by 0.5 mm and comes back; y stands. Acceleration +2, -2, -4, 4 mm/s².
    x = AxisMotion(
        np.array([0, 0, 1, 1]),
        np.array([1.0, 0.5, 0.5, 0.5]),
        np.array([0.0, 1.0, 1.75, 2.25]),
        np.array([0.0, 2.0, 1.0, 1.0]),
        np.array([2.0, -2.0, 0.0, -4.0]),
        np.zeros(4),
    )
    y = AxisMotion(np.array([0, 1]), np.array([1.5, 1.0]), *np.zeros((4, 2)))
    motion = Motion(ToolPath(np.array([0.0, 1.75, 2.0]), np.zeros(3)), x, y)
    assert motion.total_time_s == 2.5
    # The last piece turns at 2.25 + 1/8 mm.
    assert motion.overshoot_mm == pytest.approx(0.375)
    assert motion.largest_acceleration_jump_mm_s2 == 4.0
    assert motion.rms_acceleration_jump_mm_s2 == pytest.approx(np.sqrt((2**2 + 4**2 + 2**2 + 4**2 + 4**2) / 2))
    assert motion.excursion_mm == pytest.approx(0.375, abs=5e-3)  # at Gauss points


def test_a_dwell_of_many_pieces_is_one_segment() -> None:
    path = ToolPath(np.array([0.0, 1.0, 2.0]), np.zeros(3))
    motion = motion_of_schedule(schedule(path, np.array([9.0, 1.0]), PAPER_STAGES, 0.025))
    assert motion.x.segment.size > 2
    np.testing.assert_array_equal(motion.path.x_mm, path.x_mm)


@pytest.mark.parametrize("mean_s", [0.05, 0.083, 0.2])
def test_on_a_maze_pvt_never_overshoots_and_jumps_a_fraction_of_constant_acceleration(mean_s: float) -> None:
    """Wang et al. 2023, section 4.1: the same dwell times, 0.083 s a segment in the paper's job."""
    area = Rectangle(-6.0, 6.0, -6.0, 6.0)
    path = maze(area, 0.5, seed=0)
    scheduled = schedule(path, dwell_of(path, mean_s), PAPER_STAGES, 0.025, stretch=True)
    pvt = motion_of_schedule(scheduled)
    constant = constant_acceleration(path, scheduled.segment_time_s, PAPER_STAGES)
    assert constant.total_time_s == pytest.approx(pvt.total_time_s, rel=1e-3)
    assert pvt.overshoot_mm == 0.0
    assert constant.overshoot_mm > 1e-3
    assert pvt.rms_acceleration_jump_mm_s2 < 0.4 * constant.rms_acceleration_jump_mm_s2
