"""The closed forms of the certificate against dense sampling of the same cubics."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.machine.program import AxisProgram, PvtProgram
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.certificate import axis_cubics, certify
from ibfctl.schedule.hermite import Cubics, excursion
from tests.property.timed_paths import make_machine

SAMPLES = 2001
# Between samples a parabola or a cubic rises by about the square of the spacing.
NEAR = 1e-5
ROUNDING = 1e-9


@st.composite
def cubics(draw: st.DrawFn) -> tuple[Cubics, Cubics]:
    """Segments of two axes with any moves and velocities, reversals and standing axes among them."""
    random = np.random.default_rng(draw(st.integers(0, 100_000)))
    segments = draw(st.integers(1, 12))
    time_s = 2 * random.integers(1, 1025, size=segments) / 1024
    axes = []
    for _ in range(2):
        speed = random.choice([1.0, 50.0])
        velocity = speed * random.normal(size=segments + 1) * random.integers(0, 2, size=segments + 1)
        move = speed * time_s * random.normal(size=segments) * random.integers(0, 2, size=segments)
        axes.append(Cubics.through(np.concatenate([[0.0], np.cumsum(move)]), velocity, time_s))
    return axes[0], axes[1]


def sampled(axis: Cubics) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and acceleration (n, SAMPLES) from the power form of each cubic, on its own."""
    u = np.linspace(0.0, 1.0, SAMPLES)
    h = axis.time_s[:, None]
    p, v0, v1 = axis.move[:, None], axis.start_velocity[:, None], axis.end_velocity[:, None]
    c2, c3 = 3 * p / h**2 - (2 * v0 + v1) / h, (v0 + v1) / h**2 - 2 * p / h**3
    t = u * h
    return v0 * t + c2 * t**2 + c3 * t**3, v0 + 2 * c2 * t + 3 * c3 * t**2, 2 * c2 + 6 * c3 * t


@given(cubics())
def test_peak_velocity_and_acceleration_bound_the_samples_and_are_reached(axes):
    for axis in axes:
        position, velocity, acceleration = sampled(axis)
        low, high = axis.velocity_range
        span = np.abs(velocity).max(axis=1) + np.abs(acceleration).max(axis=1) * axis.time_s + 1e-12
        assert (velocity.min(axis=1) - low >= -ROUNDING * span).all()
        assert (high - velocity.max(axis=1) >= -ROUNDING * span).all()
        assert (velocity.min(axis=1) - low <= NEAR * span).all()
        assert (high - velocity.max(axis=1) <= NEAR * span).all()
        np.testing.assert_allclose(np.abs(acceleration).max(axis=1), axis.peak_acceleration, rtol=1e-9, atol=1e-9)
        tau = np.linspace(0.0, 1.0, SAMPLES) * axis.time_s[:, None]
        scale = float(np.abs(position).max()) + 1.0
        np.testing.assert_allclose(axis.position(tau), axis.start[:, None] + position, atol=1e-11 * scale, rtol=1e-11)
        np.testing.assert_allclose(axis.velocity(tau), velocity, atol=1e-9 * span.max())


@given(cubics())
def test_the_excursion_bounds_the_distance_of_the_samples_from_the_chord_and_is_reached(axes):
    x, y = axes
    (px, vx, _), (py, vy, _) = sampled(x), sampled(y)
    length = np.hypot(x.move, y.move)
    # Of a segment without a move the check of standing axes takes care.
    moving = length > 0
    length = np.where(moving, length, 1.0)
    distance = np.abs(px * (y.move / length)[:, None] - py * (x.move / length)[:, None]).max(axis=1)
    bound = excursion(x, y)
    span = (np.hypot(vx, vy).max(axis=1) * x.time_s + length + 1e-12)[moving]
    assert (bound[moving] - distance[moving] >= -ROUNDING * span).all()
    assert (bound[moving] - distance[moving] <= NEAR * span).all()


@settings(max_examples=60)
@given(st.integers(0, 100_000), st.integers(1, 12), st.sampled_from([1, -1]))
def test_the_certificate_says_what_dense_sampling_of_the_integers_says(seed, segments, direction):
    random = np.random.default_rng(seed)
    machine = make_machine(counts_per_mm=(1000.0, 500.0), direction=(direction, 1), letters="BA")
    axes, nodes, peaks = {}, {}, {}
    time_samples = 2 * random.integers(5, 500, size=segments)
    time_s = time_samples / 1024
    for letter, coordinate in (("A", "y"), ("B", "x")):
        scale = machine.axis_of(coordinate).signed_counts_per_mm
        increments = random.integers(-3000, 3000, size=segments)
        velocity = random.integers(-20_000, 20_000, size=segments)
        velocity[-1] = 0
        axes[letter] = AxisProgram(increments, velocity, 100, scale)
        nodes[coordinate] = (100 + np.concatenate([[0], np.cumsum(increments)])) / scale
        motion = sampled(axis_cubics(PvtProgram(axes, {}, time_samples, 1 / 1024), axes[letter]))
        peaks[letter] = [value / abs(scale) for value in motion]
        # Forward is where the segment goes; what goes the other way is reversal.
        along = motion[1] * np.sign(increments)[:, None]
        peaks[letter].append(max(float(-along.min()), 0.0) / abs(scale))
    program = PvtProgram(axes, {"x": "B", "y": "A"}, time_samples, 1 / 1024)
    path = ToolPath(nodes["x"], nodes["y"])
    checks = {check.name: check for check in certify(program, machine, path, time_s, np.arange(segments), 0.1).checks}
    for letter, (_, velocity, acceleration, reversal) in peaks.items():
        peak = np.abs(velocity).max()
        value = checks[f"peak_velocity_mm_s.{letter}"].value
        assert peak * (1 - ROUNDING) <= value <= peak * (1 + NEAR) + NEAR
        np.testing.assert_allclose(
            checks[f"peak_acceleration_mm_s2.{letter}"].value, np.abs(acceleration).max(), rtol=1e-9
        )
        scale = machine.axes[letter].counts_per_mm
        value = checks[f"reversal_counts_s.{letter}"].value / scale
        # It is rounded to a millionth of a count/s.
        assert reversal - 1e-6 / scale <= value <= reversal + NEAR * (peak + 1)
