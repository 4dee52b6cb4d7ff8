"""The cycle time that a CNC takes for a rounded path, and its axis limits, against Essid et al. 2019."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.path.maze import maze
from ibfctl.path.smoothing import drive_shares, smooth_corners
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.kinematics import CORNER_LIMITS, CornerTiming, time_corners
from ibfctl.schedule.kinematics_drive import Drive
from ibfctl.schedule.kinematics_line import Lines
from ibfctl.schedule.kinematics_profile import BINDING, axis_profile
from ibfctl.surface.map import Rectangle

FloatArray = NDArray[np.float64]

# Table 2: 20 m/min, 1 m/s², 15 m/s³, 10 m/s³ in the transitions.
TABLE_2 = Drive(
    (20_000 / 60,) * 2, (1000.0,) * 2, (15_000.0,) * 2, (10_000.0,) * 2,
    radial_acceleration_share=0.2, radial_jerk_share=0.2, cycle_s=0.008, sampling_factor=0.125,
)  # fmt: skip
FEED_MM_S, RHO_MM, CHORD_ERROR_MM = 3000 / 60, 0.1, 0.5


def curve(u: FloatArray) -> FloatArray:
    """The paper's test curve, Eq. 32, (2, k)."""
    return np.stack([100 * u, 100 * (3 * u**3 - 4 * u**2 + u)])


def chord_error_mm(first: float, last: float) -> float:
    points = curve(np.linspace(first, last, 301))
    along = points[:, -1] - points[:, 0]
    return float(np.abs(along[0] * (points[1] - points[1, 0]) - along[1] * (points[0] - points[0, 0])).max()) / float(
        np.hypot(*along)
    )


def chords(error_mm: float) -> list[float]:
    """Ends of chords, each as long as its error allows."""
    ends = [0.0]
    while chord_error_mm(ends[-1], 1.0) > error_mm:
        low, high = ends[-1], 1.0
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if chord_error_mm(ends[-1], middle) <= error_mm else (low, middle)
        ends.append(low)
    return [*ends, 1.0]


def curve_as_chords() -> ToolPath:
    """As few chords as the error allows, all with the same error."""
    fewest = len(chords(CHORD_ERROR_MM))
    low, high = 0.0, CHORD_ERROR_MM
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if len(chords(middle)) <= fewest else (middle, high)
    return ToolPath(*curve(np.array(chords(high))))


@pytest.fixture(scope="module")
def timings() -> dict[str, CornerTiming]:
    path = curve_as_chords()
    shares = {"drive": drive_shares(path), "full": np.ones(path.segments - 1)}
    return {
        name: time_corners(smooth_corners(path, RHO_MM, share), TABLE_2, FEED_MM_S) for name, share in shares.items()
    }


def test_the_papers_cycle_times(timings: dict[str, CornerTiming]) -> None:
    drive, full = timings["drive"], timings["full"]
    assert drive.corners.path.segments == 10
    assert np.count_nonzero(drive_shares(drive.corners.path) == 0.6) == 2  # y reverses twice
    assert drive.cycle_time_s == pytest.approx(3.063, rel=0.03)
    assert full.cycle_time_s == pytest.approx(2.943, rel=0.03)
    assert full.cycle_time_s < drive.cycle_time_s
    # The machine took 3.024 s.
    assert drive.cycle_time_s == pytest.approx(3.024, rel=0.02)


def test_the_samples_are_the_motion(timings: dict[str, CornerTiming]) -> None:
    timing = timings["drive"]
    profile = axis_profile(timing)
    steps_s = np.diff(profile.time_s)
    assert steps_s.max() <= TABLE_2.sample_s * (1 + 1e-9)
    assert profile.time_s[-1] == pytest.approx(timing.cycle_time_s, rel=1e-9)
    np.testing.assert_allclose(profile.position_mm[:, -1], curve(np.ones(1))[:, 0], atol=1e-9)
    velocity, position = profile.velocity_mm_s, profile.position_mm
    middle = 0.5 * (velocity[:, 1:] + velocity[:, :-1])
    # A jerk of 15 m/s³ for a millisecond bends a velocity by 2 µm/s, a step of it in curvature by some more.
    np.testing.assert_allclose(np.diff(position) / steps_s, middle, atol=0.1)


def test_no_axis_breaks_its_limits(timings: dict[str, CornerTiming]) -> None:
    for timing in timings.values():
        profile = axis_profile(timing)
        assert np.hypot(*profile.velocity_mm_s).max() <= FEED_MM_S * (1 + 1e-6)
        assert np.abs(profile.acceleration_mm_s2).max() <= 1000 * (1 + 1e-6)
        # Through the corners that are not taken at full feed the speed hardly changes: what bends the path is R_A's.
        bent = profile.acceleration_mm_s2[:, profile.binding == BINDING.index("radial jerk")]
        assert 0.8 * 200 < np.abs(bent).max() <= 1.15 * 200


def test_what_binds_is_named(timings: dict[str, CornerTiming]) -> None:
    timing = timings["drive"]
    names = [CORNER_LIMITS[code] for code in timing.binding]
    assert names.count("radial jerk") == 8
    assert names.count("feed") == 1  # a turn of seven degrees
    stiff = replace(TABLE_2, transition_j_max_mm_s3=(1e6, 1e6))
    assert {CORNER_LIMITS[code] for code in time_corners(timing.corners, stiff, FEED_MM_S).binding} == {
        "radial acceleration",
        "feed",
    }
    weak = replace(stiff, a_max_mm_s2=(20.0, 20.0), radial_acceleration_share=0.9)
    assert "leg" in [CORNER_LIMITS[code] for code in time_corners(timing.corners, weak, FEED_MM_S).binding]


def test_a_sharp_path_stops_at_every_corner() -> None:
    """Without blocks each leg is a seven-phase move from rest to rest, whose time is known."""
    path = ToolPath(np.array([0.0, 10.0, 10.0, 5.0]), np.array([0.0, 0.0, 20.0, 20.0]))
    corners = replace(smooth_corners(path, 0.1, 1.0), transition_mm=np.zeros(2))
    timing = time_corners(corners, TABLE_2, FEED_MM_S)
    ramp_s = 2 * np.sqrt(50 / 15_000)
    expected = [ramp_s + way / 50 for way in (10, 20)]
    # Five millimetres are too short for 50 mm/s: 2 v sqrt(v / j) = 5.
    assert 50 * ramp_s > 5
    top = (5 / 2 * np.sqrt(15_000)) ** (2 / 3)
    np.testing.assert_allclose(timing.leg_s, [*expected, 4 * np.sqrt(top / 15_000)], rtol=1e-9)
    assert timing.cycle_time_s == pytest.approx(timing.leg_s.sum())


def test_walking_back_takes_as_long() -> None:
    path = maze(Rectangle(0, 6, 0, 4), 0.5, seed=4)
    back = ToolPath(path.x_mm[::-1].copy(), path.y_mm[::-1].copy())
    times = [time_corners(smooth_corners(each, 0.025, 1.0), TABLE_2, FEED_MM_S).cycle_time_s for each in (path, back)]
    assert times[0] == pytest.approx(times[1], rel=1e-3)


@settings(deadline=None, max_examples=25)
@example(0, 0.003, 1.0)  # blocks shorter than a sample
@given(st.integers(0, 10_000), st.floats(0.002, 2.0), st.sampled_from([0.125, 1.0]))
def test_any_path_ends_and_keeps_its_limits(seed: int, rho_mm: float, sampling_factor: float) -> None:
    random = np.random.default_rng(seed)
    steps = random.choice([-1.0, 0.0, 0.01, 1.0], (2, 15)) + random.choice([0, 0.3], (2, 15)) * random.normal(
        size=(2, 15)
    )
    path = ToolPath(*np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1))
    drive = replace(TABLE_2, sampling_factor=sampling_factor, a_max_mm_s2=(800.0, 400.0), v_max_mm_s=(60.0, 30.0))
    timing = time_corners(smooth_corners(path, rho_mm, 1.0), drive, FEED_MM_S)
    profile = axis_profile(timing)
    assert profile.time_s[-1] == pytest.approx(timing.cycle_time_s)
    np.testing.assert_allclose(profile.position_mm[:, -1], [path.x_mm[-1], path.y_mm[-1]], atol=1e-9)
    assert (np.abs(profile.velocity_mm_s).max(axis=1) <= np.array([50.0, 30.0]) * (1 + 1e-6)).all()
    # In a block: both shares of an axis' acceleration together.
    assert (np.abs(profile.acceleration_mm_s2).max(axis=1) <= np.array([800.0, 400.0]) * (1 + 1e-6)).all()


@settings(deadline=None, max_examples=100)
@given(st.floats(0, 50), st.floats(1e-4, 100))
def test_a_speed_reached_is_reached_in_just_that_way(speed_mm_s: float, length_mm: float) -> None:
    lines = Lines(*(np.array([value]) for value in (length_mm, 1e4, 1000.0, 15_000.0)))
    first = np.array([speed_mm_s])
    last = lines.reach(first)
    time_s, jerk = lines.phases(first, last)
    way, speed, push = 0.0, speed_mm_s, 0.0
    for tau, j in zip(time_s[:, 0], jerk[:, 0], strict=True):
        way += tau * (speed + tau * (push / 2 + tau * j / 6))
        speed, push = speed + tau * (push + tau * j / 2), push + tau * j
        assert abs(push) <= 1000 * (1 + 1e-9)
    assert way == pytest.approx(length_mm, rel=1e-6)
    assert speed == pytest.approx(last[0], rel=1e-9)


@pytest.mark.parametrize(
    "change", [{"radial_jerk_share": 1.0}, {"sampling_factor": 0.0}, {"a_max_mm_s2": (0.0, 1.0)}, {"cycle_s": -1.0}]
)
def test_a_drive_that_cannot_be_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(InputError, match="drive"):
        replace(TABLE_2, **change)  # type: ignore[arg-type]


def test_a_feed_that_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="feed"):
        time_corners(smooth_corners(curve_as_chords(), RHO_MM, 1.0), TABLE_2, np.nan)
