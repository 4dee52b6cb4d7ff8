"""A tool as it is seen on a part that stands otherwise than the machine."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.surface.influence import InfluenceFunction, gaussian

RANDOM = np.random.default_rng(1)
LOPSIDED = InfluenceFunction(RANDOM.random((8, 13)), 0.2)


def turn(degrees: float, mirrored: bool = False) -> np.ndarray:
    cosine, sine = np.round([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))], 15)
    return np.array([[cosine, -sine], [sine, cosine]]) @ np.diag([-1.0 if mirrored else 1.0, 1.0])


@pytest.mark.parametrize(
    ("matrix", "expected"),
    [
        (turn(0), lambda rate: rate),
        (turn(180), lambda rate: rate[::-1, ::-1]),
        (turn(0, True), lambda rate: rate[:, ::-1]),
        # On a part that is rotated by 90 degrees the machine's y is its x: what lies along y is seen along x.
        (turn(90), lambda rate: rate.T[::-1]),
        (turn(-90), lambda rate: rate.T[:, ::-1]),
    ],
)
def test_right_angles_move_pixels(matrix: np.ndarray, expected) -> None:
    turned = LOPSIDED.turned(matrix)
    np.testing.assert_allclose(turned.rate_nm_s, expected(LOPSIDED.rate_nm_s), atol=1e-12)


@pytest.mark.parametrize("degrees", [12.0, 45.0, 133.0])
def test_a_round_tool_is_the_same_from_everywhere(degrees: float) -> None:
    tool = gaussian(1.6, 4.0, 2.4, 0.1)
    turned = tool.turned(turn(degrees))
    assert turned.rate_nm_s.shape == tool.rate_nm_s.shape
    assert turned.volume_rate_nm_mm2_s == pytest.approx(tool.volume_rate_nm_mm2_s)
    # At its rim, cut off at 4 pm/s, pixels fall to either side.
    assert np.abs(turned.rate_nm_s - tool.rate_nm_s).max() < 0.01


@pytest.mark.parametrize("degrees", [30.0, 75.0])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_long_tool_lies_where_the_part_sees_it(degrees: float, mirrored: bool) -> None:
    def rate(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.exp(-((x - 0.3) ** 2) / 0.5 - y**2 / 0.1)

    axis = 0.05 * np.arange(-60, 61)
    x, y = np.meshgrid(axis, axis)
    matrix = turn(degrees, mirrored)
    turned = InfluenceFunction(rate(x, y), 0.05).turned(matrix)
    size = turned.rate_nm_s.shape
    x, y = np.meshgrid(*(0.05 * (np.arange(n) - 0.5 * (n - 1)) for n in reversed(size)))
    there = np.einsum("ij,jkl->ikl", matrix, np.stack([x, y]))
    np.testing.assert_allclose(turned.rate_nm_s, rate(*there), atol=1e-4)
