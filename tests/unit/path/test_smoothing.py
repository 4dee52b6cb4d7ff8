"""Blocks that round corners: tangent to the segments, within the tolerance and within the segments."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.errors import InputError
from ibfctl.path.figures import distances_mm
from ibfctl.path.maze import maze
from ibfctl.path.smoothing import SmoothedCorners, drive_shares, smooth_corners
from ibfctl.path.tool_path import ToolPath
from ibfctl.surface.map import Rectangle

# Essid et al. 2019, Table 1.
TABLE_1 = ToolPath(np.array([0, 7.071, 9.659, 19.318, 26.389]), np.array([0, 7.071, 16.73, 14.142, 21.213]))
RHO_MM = 0.1


def farthest_mm(corners: SmoothedCorners, node: int) -> float:
    """Largest distance of the block at an inner node from the two segments that meet there."""
    path, found = corners.path, []
    for u in np.linspace(0, 1, 21):
        point = corners.position_mm(float(u))[:, node][None]
        legs = [
            distances_mm(point, np.array([[path.x_mm[k], path.y_mm[k]]]), np.array([[dx, dy]]))
            for k, dx, dy in zip(
                (node, node + 1), np.diff(path.x_mm)[node : node + 2], np.diff(path.y_mm)[node : node + 2], strict=True
            )
        ]
        found.append(min(leg[0] for leg in legs))
    return max(found)


def nearest_mm(corners: SmoothedCorners, node: int) -> float:
    """Smallest distance of the block at an inner node from its corner."""
    points = np.stack([corners.position_mm(float(u))[:, node] for u in np.linspace(0, 1, 201)])
    return float(np.hypot(*(points - corners.corner_mm[:, node]).T).min())


def test_the_corners_of_table_1_deviate_by_their_share_of_the_tolerance() -> None:
    shares = drive_shares(TABLE_1)
    np.testing.assert_array_equal(shares, [0.8, 0.6, 0.6])
    corners = smooth_corners(TABLE_1, RHO_MM, shares)
    turn_deg = np.degrees(2 * np.arcsin(np.hypot(*(corners.after - corners.before)) / 2))
    np.testing.assert_allclose(turn_deg, [30, 90, 60], atol=0.01)
    np.testing.assert_allclose(corners.deviation_mm, shares * RHO_MM, rtol=1e-12)
    np.testing.assert_allclose([nearest_mm(corners, node) for node in range(3)], shares * RHO_MM, rtol=1e-6)


def test_transition_lengths_follow_from_eq_13() -> None:
    corners = smooth_corners(TABLE_1, RHO_MM, drive_shares(TABLE_1))
    difference = corners.before - corners.after
    bisector = -difference / np.hypot(*difference)
    by_x = 8 * drive_shares(TABLE_1) * RHO_MM * bisector[0] / (4 * difference[0] - 2.5 * difference[0])
    np.testing.assert_allclose(corners.transition_mm, np.abs(by_x), rtol=1e-9)


def test_blocks_are_tangent_to_the_segments_and_lie_on_them_at_their_ends() -> None:
    corners = smooth_corners(TABLE_1, RHO_MM, 1.0)
    step = 1e-6
    for end, direction, sign in ((0.0, corners.before, -1), (1.0, corners.after, 1)):
        there, inside = corners.position_mm(end), corners.position_mm(end - sign * step)
        np.testing.assert_allclose(there, corners.corner_mm + sign * corners.transition_mm * direction, atol=1e-12)
        along = sign * (there - inside)
        np.testing.assert_allclose(along / np.hypot(*along), direction, atol=1e-5)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10_000), st.floats(0.001, 3.0))
def test_no_random_path_leaves_its_tolerance_or_its_segments(seed: int, tolerance_mm: float) -> None:
    random = np.random.default_rng(seed)
    # Some nodes are repeated, some go straight on, some turn right back.
    steps = random.choice([-1.0, 0.0, 0.5, 1.0], (2, 12)) + random.choice([0, 0.3], (2, 12)) * random.normal(
        size=(2, 12)
    )
    path = ToolPath(*np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1))
    corners = smooth_corners(path, tolerance_mm, 1.0)
    assert corners.largest_deviation_mm <= tolerance_mm * (1 + 1e-12)
    assert np.isfinite(corners.coefficients_mm).all()
    assert (corners.transition_mm[:-1] + corners.transition_mm[1:] <= path.length_mm[1:-1] + 1e-12).all()
    for node in range(path.segments - 1):
        assert farthest_mm(corners, node) <= corners.deviation_mm[node] + 1e-9
        assert nearest_mm(corners, node) <= tolerance_mm * (1 + 1e-9)


def test_a_maze_is_rounded_at_every_turn_and_nowhere_else() -> None:
    path = maze(Rectangle(0, 6, 0, 4), 0.5, seed=1)
    corners = smooth_corners(path, 0.025, 1.0)
    np.testing.assert_array_equal(corners.transition_mm > 0, ~path.straight)
    assert corners.deviation_mm[~path.straight] == pytest.approx(0.025)
    assert drive_shares(path) == pytest.approx(0.8)  # no axis reverses in a maze


def test_a_wide_tolerance_takes_no_more_than_half_of_a_segment() -> None:
    corners = smooth_corners(maze(Rectangle(0, 6, 0, 4), 0.5, seed=1), 5.0, 1.0)
    assert corners.transition_mm.max() == pytest.approx(0.25)
    assert corners.leg_mm.min() >= 0


@pytest.mark.parametrize(("tolerance_mm", "share"), [(0.0, 1.0), (-1.0, 1.0), (np.nan, 1.0), (0.1, 0.0), (0.1, 1.5)])
def test_what_cannot_be_is_refused(tolerance_mm: float, share: float) -> None:
    with pytest.raises(InputError, match="corner"):
        smooth_corners(TABLE_1, tolerance_mm, share)
