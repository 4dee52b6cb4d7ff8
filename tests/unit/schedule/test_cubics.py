"""The cubic of the controller: worked examples of its manuals, and exact arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from ibfctl.machine.program import AxisProgram, PvtProgram
from ibfctl.schedule.certificate import axis_cubics
from ibfctl.schedule.hermite import Cubics, excursion

SAMPLE_S = Fraction(1, 1024)

# A parabolic speed up to 1000 counts/s and down again, 256 samples each (DMC-40x0 manual, PVT mode).
PARABOLA_COUNTS = (57, 151, 214, 245, 245, 214, 151, 57)
PARABOLA_COUNTS_S = (437.5, 750.0, 937.5, 1000.0, 937.5, 750.0, 437.5, 0.0)

# Two axes (DMC-41x3 manual): (counts, counts/s, samples); the first row of A is not known, here it stands still.
TWO_AXES = {
    "A": ((0, 0, 500), (1000, 4000, 1200), (1000, 4000, 750), (800, 10000, 250), (4000, 0, 1000)),
    "B": ((500, 5000, 500), (4500, 0, 1200), (-1000, 1000, 750), (200, 1000, 250), (-900, 0, 1000)),
}


def segment(p: int, v0: int, v: int, samples: int) -> tuple[Fraction, Fraction]:
    """c2 and c3 of pos(tau) = v0 tau + c2 tau^2 + c3 tau^3."""
    h = samples * SAMPLE_S
    return 3 * p / h**2 - (2 * v0 + v) / h, (v0 + v) / h**2 - 2 * p / h**3


def test_the_parabola_of_the_manual_moves_1334_counts_in_two_seconds() -> None:
    position = np.concatenate([[0.0], np.cumsum(PARABOLA_COUNTS)])
    time_s = np.full(8, 256 / 1024)
    cubics = Cubics.through(position, np.array([0.0, *PARABOLA_COUNTS_S]), time_s)
    assert time_s.sum() == 2.000
    assert cubics.position(time_s)[-1] == pytest.approx(1334, abs=1e-9)
    np.testing.assert_allclose(cubics.position(time_s), position[1:], atol=1e-9)
    np.testing.assert_allclose(cubics.velocity(time_s), PARABOLA_COUNTS_S, atol=1e-9)
    # Between the nodes too: the whole is v(t) = 1000 (1 - (t - 1)^2) but for the rounding of p to counts.
    tau = np.linspace(0.0, 0.25, 33) * np.ones((8, 1))
    t = 0.25 * np.arange(8)[:, None] + tau
    rounding_counts_s = 1.5 * 0.5 / 0.25
    assert np.abs(cubics.velocity(tau) - 1000 * (1 - (t - 1) ** 2)).max() <= rounding_counts_s
    assert np.abs(cubics.position(tau) - 1000 * (t**2 - t**3 / 3)).max() <= 1.0
    low, high = cubics.velocity_range
    assert high.max() == pytest.approx(1000.0, abs=rounding_counts_s)
    assert low.min() == 0.0
    assert cubics.peak_acceleration.max() == pytest.approx(2000.0, abs=4 * rounding_counts_s / 0.25)


def test_the_second_example_of_the_manual_on_two_axes() -> None:
    axes = {
        letter: AxisProgram(np.array([p for p, _, _ in rows]), np.array([v for _, v, _ in rows]), 0, 1.0)
        for letter, rows in TWO_AXES.items()
    }
    samples = np.array([t for _, _, t in TWO_AXES["A"]])
    assert samples.tolist() == [t for _, _, t in TWO_AXES["B"]]
    program = PvtProgram(axes, {"x": "A", "y": "B"}, samples, float(SAMPLE_S))
    assert program.total_time_s == 3700 / 1024
    assert axes["A"].end_counts == 6800
    assert axes["B"].end_counts == 3300
    for letter, rows in TWO_AXES.items():
        cubics = axis_cubics(program, axes[letter])
        base, v0 = 0, 0
        for index, (p, v, count) in enumerate(rows):
            c2, c3 = segment(p, v0, v, count)
            h = count * SAMPLE_S
            one = Cubics(*(np.asarray(part)[[index]] for part in vars(cubics).values()))
            for sample in range(0, count + 1, 50):
                tau = sample * SAMPLE_S
                got = one.position(np.array([float(tau)]))[0]
                assert got == pytest.approx(float(base + v0 * tau + c2 * tau**2 + c3 * tau**3), abs=1e-8)
                got = one.velocity(np.array([float(tau)]))[0]
                assert got == pytest.approx(float(v0 + 2 * c2 * tau + 3 * c3 * tau**2), abs=1e-8)
            assert one.start_acceleration[0] == pytest.approx(float(2 * c2), abs=1e-8)
            assert one.end_acceleration[0] == pytest.approx(float(2 * c2 + 6 * c3 * h), abs=1e-8)
            extremes = [Fraction(v0), Fraction(v)]
            if c3 != 0 and 0 < -c2 / (3 * c3) < h:
                extremes.append(v0 - c2**2 / (3 * c3))
            low, high = one.velocity_range
            assert low[0] == pytest.approx(float(min(extremes)), abs=1e-8)
            assert high[0] == pytest.approx(float(max(extremes)), abs=1e-8)
            base, v0 = base + p, v
    # B's second row overshoots its own end speeds: 4500 counts from 5000 counts/s to rest in 1200 samples.
    _, high = axis_cubics(program, axes["B"]).velocity_range
    assert high[1] > 5000


def test_an_acceleration_jump_is_what_follows_minus_what_precedes_rest_at_both_ends() -> None:
    cubics = Cubics.through(np.array([0.0, 1.0, 4.0]), np.array([0.0, 2.0, 0.0]), np.array([1.0, 2.0]))
    # 6 s/h² - (4 v0 + 2 v1)/h at a start, -6 s/h² + (2 v0 + 4 v1)/h at an end
    assert cubics.start_acceleration.tolist() == [2.0, 0.5]
    assert cubics.end_acceleration.tolist() == [2.0, -2.5]
    assert cubics.acceleration_jumps.tolist() == [2.0, -1.5, 2.5]


@pytest.mark.parametrize(
    ("move", "start", "end", "expected"),
    [
        ((10.0, 0.0), (1.0, 0.0), (3.0, 0.0), 0.0),  # along the chord
        ((10.0, 0.0), (0.0, 1.0), (0.0, -1.0), 0.25),  # a bow: u (1 - u) h
        ((10.0, 0.0), (0.0, 1.0), (0.0, 0.0), 4 / 27),  # leaves across, arrives along: u (1 - u)^2 h
        ((10.0, 0.0), (0.0, 0.0), (0.0, -1.0), 4 / 27),
        ((10.0, 0.0), (0.0, 1.0), (0.0, 1.0), np.sqrt(3) / 18),  # an S: u (1 - u)(1 - 2u) h
        ((3.0, 4.0), (-4.0, 3.0), (4.0, -3.0), 5 * 0.25),  # the bow on a slanted chord, at speed 5
    ],
)
def test_known_excursions_from_the_chord(
    move: tuple[float, float], start: tuple[float, float], end: tuple[float, float], expected: float
) -> None:
    x, y = (
        Cubics(np.zeros(1), np.array([move[k]]), np.array([start[k]]), np.array([end[k]]), np.ones(1)) for k in (0, 1)
    )
    assert excursion(x, y)[0] == pytest.approx(expected, abs=1e-12)
