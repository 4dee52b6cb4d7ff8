"""A smoothed path in pieces: through the middles of its blocks, with the times of its segments shared among them."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.path.figures import distances_mm
from ibfctl.path.maze import maze
from ibfctl.path.smoothing import smooth_corners
from ibfctl.path.smoothing_pieces import in_pieces, smoothed_path
from ibfctl.path.tool_path import ToolPath
from ibfctl.surface.map import Rectangle

TOLERANCE_MM = 0.05


def path_of(*nodes: tuple[float, float]) -> ToolPath:
    return ToolPath(*(np.array(values, dtype=float) for values in zip(*nodes, strict=True)))


def test_an_elbow_is_walked_in_four_pieces() -> None:
    corners = smooth_corners(path_of((0, 0), (4, 0), (4, 2)), TOLERANCE_MM, 1.0)
    smoothed = in_pieces(corners, TOLERANCE_MM, TOLERANCE_MM, 0.01)
    length = corners.transition_mm[0]
    middle = TOLERANCE_MM / np.sqrt(2)
    np.testing.assert_allclose(smoothed.pieces.x_mm, [0, 4 - length, 4 - middle, 4, 4])
    np.testing.assert_allclose(smoothed.pieces.y_mm, [0, 0, middle, length, 2])
    np.testing.assert_array_equal(smoothed.segment, [0, 0, 1, 1])
    # Where a leg is walked at constant speed, half a block takes 2.5 / 2 of its length.
    np.testing.assert_allclose(smoothed.share[:2], np.array([4 - length, 1.25 * length]) / (4 + 0.25 * length))


@pytest.mark.parametrize("kind", ["maze", "walk"])
def test_every_segment_keeps_its_time_and_its_place(kind: str) -> None:
    random = np.random.default_rng(2)
    walk = np.cumsum(random.integers(-1, 2, (2, 80)), axis=1) + 0.2 * random.normal(size=(2, 80)) * (np.arange(80) > 40)
    walk[:, 10] = walk[:, 9]  # a repeated node
    path = maze(Rectangle(0, 6, 0, 4), 0.5, seed=1) if kind == "maze" else ToolPath(*walk)
    smoothed = smoothed_path(path, TOLERANCE_MM, TOLERANCE_MM)
    np.testing.assert_allclose(smoothed.sums(smoothed.share), 1.0)
    assert (smoothed.share >= 0).all()
    assert (np.diff(smoothed.segment) >= 0).all()
    np.testing.assert_array_equal(np.unique(smoothed.segment), np.arange(path.segments))
    nodes = np.column_stack([smoothed.pieces.x_mm, smoothed.pieces.y_mm])
    programmed = np.column_stack([path.x_mm, path.y_mm])
    np.testing.assert_array_equal(nodes[[0, -1]], programmed[[0, -1]])
    # A piece begins and ends within what the corridor leaves of the tolerance from its own segment.
    starts, moves = programmed[smoothed.segment], np.diff(programmed, axis=0)[smoothed.segment]
    for ends in (nodes[:-1], nodes[1:]):
        assert distances_mm(ends, starts, moves).max() <= 0.7 * TOLERANCE_MM + 1e-12
    # The first node of each segment is its corner or the middle of the block there.
    first = np.searchsorted(smoothed.segment, np.arange(path.segments))
    assert np.hypot(*(nodes[first] - programmed[:-1]).T).max() <= TOLERANCE_MM + 1e-12


def test_rounding_of_nodes_and_motion_around_chords_come_out_of_the_tolerance() -> None:
    path = path_of((0, 0), (4, 0), (8, 1))  # a turn of 14 degrees: the cosine of half of it is near one
    corners = smoothed_path(path, TOLERANCE_MM, TOLERANCE_MM, rounding_mm=0.001).corners
    cosine = np.cos(0.5 * np.arctan2(1, 4))
    assert corners.deviation_mm[0] * cosine == pytest.approx(0.7 * (TOLERANCE_MM - 0.001), abs=1e-12)


def test_corners_side_by_side_leave_no_crumbs() -> None:
    """Where two blocks fill a segment there is one node between them, not two a hair apart."""
    path = maze(Rectangle(0, 6, 0, 4), 0.5, seed=1)
    smoothed = in_pieces(smooth_corners(path, 5.0, 1.0), 5.0, 5.0, 1.0)
    assert smoothed.corners.leg_mm.min() == pytest.approx(0.0, abs=1e-12)
    assert smoothed.pieces.length_mm.min() > 0.1


def test_gentle_turns_stay_as_they_are() -> None:
    turn = np.linspace(0, 20, 300)
    spiral = ToolPath(3 * turn * np.cos(turn), 3 * turn * np.sin(turn))
    dense = ToolPath(spiral.x_mm[200:] / 20, spiral.y_mm[200:] / 20)
    smoothed = smoothed_path(dense, TOLERANCE_MM, TOLERANCE_MM)
    assert not smoothed.corners.transition_mm.any()
    np.testing.assert_array_equal(smoothed.pieces.x_mm, dense.x_mm)
    np.testing.assert_allclose(smoothed.share, 1.0)
    assert smoothed.corridor_mm == pytest.approx(TOLERANCE_MM)


def test_the_corridor_is_narrow_around_blocks_alone() -> None:
    smoothed = smoothed_path(path_of((0, 0), (4, 0), (4, 2)), TOLERANCE_MM, TOLERANCE_MM)
    np.testing.assert_allclose(smoothed.corridor_mm, np.array([1.0, 0.3, 0.3, 1.0]) * TOLERANCE_MM)
