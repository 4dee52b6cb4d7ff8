"""The servo model: off by default, and what it does when it is on."""

from __future__ import annotations

import numpy as np
import pytest
from ibfctl_simulator.galil.servo import Servo, ServoModel

PERIOD_S = 1 / 1024


def follow(servo, commanded):
    seen = []
    previous = 0.0
    for value in commanded:
        [load] = servo.look(np.array([value]), previous, PERIOD_S)
        servo.take(1, np.array([value]))
        previous = value
        seen.append(load)
    return np.array(seen)


def test_the_default_follows_perfectly(console):
    console.good("JGA=20000", "BGA")
    for _ in range(10):
        console.controller.advance(37)
        assert console.number("_TEA") == 0


def test_a_lag_trails_by_speed_times_time_constant():
    servo = Servo(ServoModel(kind="lag", time_constant_s=0.01))
    ramp = np.arange(1, 1025) * 10.0
    assert ramp[-1] - follow(servo, ramp)[-1] == pytest.approx(10 * 1024 * 0.01, rel=1e-6)


def test_a_second_order_servo_settles_on_a_step_and_overshoots_as_its_damping_says():
    servo = Servo(ServoModel(kind="second_order", natural_frequency_hz=10, damping=0.5, velocity_feedforward=False))
    track = follow(servo, np.full(2048, 1000.0))
    assert track[-1] == pytest.approx(1000.0, abs=0.01)
    # exp(-pi zeta / sqrt(1 - zeta^2)) is 16.3 % for zeta 0.5; the discrete loop is within a few per cent of it.
    assert track.max() == pytest.approx(1163, abs=25)


def test_feedforward_removes_the_lag_at_constant_speed():
    model = ServoModel(kind="second_order", natural_frequency_hz=30)
    ramp = np.arange(1, 3001) * 5.0
    assert abs(ramp[-1] - follow(Servo(model), ramp)[-1]) < 1.0


def test_the_torque_limit_bounds_the_acceleration():
    servo = Servo(ServoModel(kind="second_order", acceleration_limit_counts_s2=50_000.0))
    servo.torque_limit_volts = 9.9982 / 2
    track = np.concatenate(([0.0, 0.0], follow(servo, np.full(500, 100_000.0))))
    acceleration = np.diff(track, 2) / PERIOD_S**2
    assert np.abs(acceleration).max() == pytest.approx(25_000.0, rel=1e-6)
    assert servo.torque_volts <= 9.9982 / 2


def test_looking_ahead_and_stepping_give_the_same_track():
    model = ServoModel(kind="second_order", encoder_noise_counts=2.0, encoder_resolution_counts=5)
    commanded = np.cumsum(np.linspace(0, 30, 300))
    whole = Servo(model)
    ahead = whole.look(commanded, 0.0, PERIOD_S)
    stepped = follow(Servo(model), commanded)
    assert np.array_equal(ahead, stepped)
    readings = whole.read(ahead, 1000)
    pieces = np.concatenate([whole.read(ahead[i : i + 7], 1000 + i) for i in range(0, 300, 7)])
    assert np.array_equal(readings, pieces)
    assert np.all(readings % 5 == 0)
    assert 1.0 < np.std(readings - ahead) < 4.0


def test_a_lagging_axis_settles_after_its_profile_has_ended(make_console):
    console = make_console(servo=ServoModel(kind="lag", time_constant_s=0.02))
    console.good("SHA", "PVA=1000,0,100", "PVA=0,0,0", "BTA")
    console.controller.advance(100)
    assert (console.number("_BGA"), console("SCA")) == (0, "31\r\n:")
    assert console.number("_TEA") > 50
    console.controller.advance(1000)
    assert console.number("_TEA") == 0
