"""Dwell bounds: the numbers of Zhang et al. 2021, and the motion that the bounds promise."""

import numpy as np
import pytest

from ibfctl.dwell.bounds import (
    SpeedRamp,
    accelerating_bounds,
    advised_speeds_mm_s,
    characteristic_speed_mm_s,
    decelerating_bounds,
    dwell_bounds,
)
from ibfctl.errors import InputError, LimitsError

G_MM_S2 = 9800.0  # the paper's g
MM_MIN = 1 / 60
PAPER = SpeedRamp(200 * MM_MIN, 4000 * MM_MIN, 0.3 * G_MM_S2)


def test_the_bounds_of_the_papers_experiment() -> None:
    bounds = dwell_bounds(np.array([2.09]), PAPER)  # Eq. 22 prints 0.04157 and 0.4222 s
    assert bounds.lower_s == pytest.approx([0.0416], abs=5e-5)
    assert bounds.upper_s == pytest.approx([0.422], abs=5e-4)


def test_the_papers_characteristic_speed() -> None:
    # Section 4.2.3 prints 6675.6 mm/min at f = 1/20: a step of 2.1 mm; its experiment's 2.09 mm give 6659.7.
    assert characteristic_speed_mm_s(np.array([2.1, 2.09]), 0.3 * G_MM_S2, 1 / 20) / MM_MIN == pytest.approx(
        [6675.6, 6659.7], abs=0.05
    )
    assert np.array(advised_speeds_mm_s(2.1, 0.3 * G_MM_S2, 1 / 20)) / MM_MIN == pytest.approx(
        [0.6 * 6675.6, 0.8 * 6675.6], abs=0.05
    )


def test_both_stages_hold_in_the_combined_bounds() -> None:
    step_mm = np.array([2.09, 5.0, 40.0])
    both = dwell_bounds(step_mm, PAPER)
    for stage in (accelerating_bounds(step_mm, PAPER), decelerating_bounds(step_mm, PAPER)):
        assert (both.lower_s >= stage.lower_s).all()
        assert (both.upper_s <= stage.upper_s).all()
        assert (both.lower_s < both.upper_s).all()


def test_at_the_characteristic_speed_one_time_is_left_and_beyond_it_none() -> None:
    step_mm, ratio = np.array([2.09]), 0.05
    (speed_mm_s,) = characteristic_speed_mm_s(step_mm, PAPER.a_mm_s2, ratio)
    only = dwell_bounds(step_mm, SpeedRamp(ratio * speed_mm_s, speed_mm_s, PAPER.a_mm_s2))
    assert only.lower_s == pytest.approx(only.upper_s, rel=1e-9)
    with pytest.raises(LimitsError, match="characteristic speed"):
        dwell_bounds(step_mm, SpeedRamp(ratio * 1.01 * speed_mm_s, 1.01 * speed_mm_s, PAPER.a_mm_s2))


def test_any_times_within_the_bounds_keep_every_speed_in_its_range() -> None:
    # Eq. 6: the speed after each step, from that before it.
    random, ramp = np.random.default_rng(3), PAPER
    step_mm = random.uniform(2.09, 6.0, 4000)
    bounds = dwell_bounds(step_mm, ramp)
    extreme = random.integers(0, 2, step_mm.size).astype(bool)
    times_s = np.where(extreme, bounds.lower_s, bounds.upper_s)
    times_s[::3] = random.uniform(bounds.lower_s, bounds.upper_s)[::3]
    speed = ramp.v_min_mm_s
    seen = []
    for s, t in zip(step_mm, times_s, strict=True):
        a = np.copysign(ramp.a_mm_s2, s - speed * t)
        root = np.sqrt(t**2 - 2 * (s - speed * t) / a)
        speed += a * (t - root)
        seen.append(speed)
    assert ramp.v_min_mm_s * (1 - 1e-9) <= min(seen)
    assert max(seen) <= ramp.v_max_mm_s * (1 + 1e-9)
    assert max(seen) - min(seen) > 0.9 * (ramp.v_max_mm_s - ramp.v_min_mm_s)


@pytest.mark.parametrize("speeds", [(0.0, 10.0), (10.0, 10.0), (5.0, np.inf), (np.nan, 10.0)])
def test_speeds_that_are_no_range_are_refused(speeds: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="no range"):
        SpeedRamp(*speeds, 100.0)


@pytest.mark.parametrize("acceleration", [0.0, -1.0, np.nan])
def test_an_acceleration_that_is_none_is_refused(acceleration: float) -> None:
    with pytest.raises(InputError, match="acceleration"):
        SpeedRamp(1.0, 10.0, acceleration)
