"""Trapezoids and contours against their definitions, for any distance, speed and acceleration."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.phases import move_phases
from ibfctl_simulator.galil.settings import Settings

RATES = st.floats(1024, 1e7)
SPEEDS = st.floats(2, 1e6)


@given(
    distance=st.floats(-1e6, 1e6),
    velocity=st.floats(-1e5, 1e5),
    speed=SPEEDS,
    acceleration=RATES,
    deceleration=RATES,
)
@settings(deadline=None)
def test_any_move_ends_at_its_target_at_rest_and_keeps_its_limits(
    distance, velocity, speed, acceleration, deceleration
):
    assume(abs(distance) > 1e-3)
    position, now = 0.0, velocity
    # At rest but for rounding, its sign does not say whether a phase slows: either limit may be the right one.
    rest = 1e-6 * max(speed, abs(velocity), 1.0)
    for duration, rate in move_phases(distance, velocity, speed, acceleration, deceleration):
        assert duration >= 0.0
        limit = deceleration if rate * now < 0.0 else acceleration
        limit = max(deceleration, acceleration) if abs(now) <= rest else limit
        assert abs(rate) <= limit * (1 + 1e-9)
        position += now * duration + rate * duration**2 / 2
        now += rate * duration
        assert abs(now) <= max(speed, abs(velocity)) * (1 + 1e-9)
    assert position == pytest.approx(distance, rel=1e-9, abs=1e-3)
    assert now == pytest.approx(0.0, abs=rest)


@given(
    records=st.lists(
        st.tuples(st.integers(-32762, 32762), st.integers(-32762, 32762), st.integers(1, 8)), min_size=1, max_size=20
    )
)
@settings(deadline=None)
def test_every_contour_sample_is_within_half_a_count_of_its_line(records):
    controller = Controller(Settings(motor_on_at_start=True))
    for command in ("CM AB", "DT -1", *[f"CD {a},{b}={n}" for a, b, n in records], "CD 0,0=0", "DT 1"):
        assert controller.reply(command, "A") == ":"
    times = np.cumsum([0, *[2**n for _, _, n in records]])
    corners = np.cumsum([(0, 0), *[(a, b) for a, b, _ in records]], axis=0)
    samples = np.arange(1, times[-1] + 1)
    seen = np.empty((len(samples), 2))
    for index in range(len(samples)):
        controller.advance(1)
        seen[index] = [axis.encoder_counts for axis in controller.state.axes]
    for axis in (0, 1):
        lines = np.interp(samples, times, corners[:, axis])
        assert np.abs(seen[:, axis] - lines).max() <= 0.5 + 1e-6
    controller.advance(1)
    assert [axis.stop_code for axis in controller.state.axes] == [51, 51]
