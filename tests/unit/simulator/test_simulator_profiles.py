"""Trapezoids: distances, times, limits, and moves that start at speed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ibfctl_simulator.galil.phases import jog_phases, move_phases, stop_phases
from ibfctl_simulator.galil.profiles import PhasedProfile

PERIOD_S = 1 / 1024


def run(profile, most=100_000):
    positions = []
    while profile.end_code is None and len(positions) < most:
        looked = profile.look(777)
        positions.extend(looked)
        profile.take(len(looked))
    return np.array(positions)


def travelled(phases, velocity):
    position = 0.0
    for duration, acceleration in phases:
        position += velocity * duration + acceleration * duration**2 / 2
        velocity += acceleration * duration
    return position, velocity


@pytest.mark.parametrize("distance", [100_000.0, 100.0, 1.0, -5000.0, -3.0])
@pytest.mark.parametrize("velocity", [0.0, 1500.0, -1500.0, 9000.0])
def test_a_move_ends_at_its_target_at_rest_within_its_limits(distance, velocity):
    phases = move_phases(distance, velocity, 4000.0, 30_000.0, 20_000.0)
    end, end_velocity = travelled(phases, velocity)
    assert end == pytest.approx(distance, abs=1e-6)
    assert end_velocity == pytest.approx(0.0, abs=1e-6)
    assert all(abs(rate) <= 30_000.0 and duration >= 0.0 for duration, rate in phases)


def test_a_long_move_takes_the_time_of_the_trapezoid():
    phases = move_phases(10_000.0, 0.0, 2000.0, 10_000.0, 5000.0)
    # Ramps of 0.2 s and 0.4 s over 600 counts, and 4.7 s at speed.
    assert [duration for duration, _ in phases] == pytest.approx([0.2, 4.7, 0.4])


def test_no_distance_needs_no_phase():
    assert move_phases(0.0, 0.0, 1000.0, 1e5, 1e5) == []


def test_a_profile_samples_its_phases_and_ends_on_the_target():
    phases = move_phases(10_000.0, 0.0, 2000.0, 10_000.0, 5000.0)
    profile = PhasedProfile(500.0, 0.0, phases, sample_period_s=PERIOD_S, end_code=1, end_counts=10_500.0)
    positions = run(profile)
    assert len(positions) == math.ceil(5.3 * 1024)
    assert positions[-1] == 10_500.0
    assert positions[1023] == pytest.approx(500.0 + 200.0 + 0.8 * 2000.0)
    assert (profile.position_counts, profile.velocity_counts_s, profile.end_code) == (10_500.0, 0.0, 1)


def test_a_jog_changes_through_rest_and_lasts():
    phases = jog_phases(1000.0, -2000.0, 4000.0, 10_000.0)
    assert phases[:2] == [(0.1, -10_000.0), (0.5, -4000.0)]
    profile = PhasedProfile(0.0, 1000.0, phases, sample_period_s=PERIOD_S, end_code=1)
    run(profile, 5000)
    assert profile.velocity_counts_s == -2000.0
    assert profile.end_code is None


def test_a_slower_jog_uses_the_deceleration():
    assert jog_phases(2000.0, 1000.0, 4000.0, 10_000.0)[0] == (0.1, -10_000.0)


def test_stopping_takes_the_braking_distance_and_lands_on_a_count():
    phases = stop_phases(-1000.0, 2000.0)
    profile = PhasedProfile(10.25, -1000.0, phases, sample_period_s=PERIOD_S, end_code=4)
    positions = run(profile)
    assert positions[-1] == round(10.25 - 250.0)
    assert len(positions) == 512


def test_an_axis_at_rest_needs_no_braking():
    profile = PhasedProfile(7.0, 0.0, stop_phases(0.0, 2000.0), sample_period_s=PERIOD_S, end_code=4)
    assert profile.end_code == 4
