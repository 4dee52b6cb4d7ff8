"""Figures of paths whose figures are known."""

import numpy as np
import pytest

from ibfctl.path.figures import distances_mm, path_figures
from ibfctl.path.maze import maze
from ibfctl.path.raster import raster
from ibfctl.path.tool_path import ToolPath
from ibfctl.surface.map import Rectangle

AREA = Rectangle(0.0, 6.0, 0.0, 4.0)


def pixels(step_mm: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.arange(0, 6 + 1e-9, step_mm), np.arange(0, 4 + 1e-9, step_mm))
    return x.ravel(), y.ravel()


def nodes(*points: tuple[float, float]) -> ToolPath:
    x, y = np.array(points, dtype=float).T
    return ToolPath(x.copy(), y.copy())


def test_a_raster_leaves_half_its_pitch() -> None:
    figures = path_figures(raster(AREA, 1.0, 0.5), pixels())
    assert figures.largest_gap_mm == pytest.approx(0.5, abs=1e-9)
    assert figures.shortest_step_mm == pytest.approx(0.5)
    assert figures.sharpest_corner_deg == pytest.approx(90.0)
    assert figures.length_mm == pytest.approx(5 * 6.0 + 4 * 1.0)


def test_the_gap_lies_between_nodes_however_far_apart_they_are() -> None:
    sparse = path_figures(raster(AREA, 1.0, 3.0), pixels())
    assert sparse.largest_gap_mm == pytest.approx(0.5, abs=1e-9)


def test_a_maze_leaves_at_most_half_a_diagonal() -> None:
    figures = path_figures(maze(AREA, 0.5, seed=3), pixels())
    assert figures.largest_gap_mm is not None
    assert 0.25 <= figures.largest_gap_mm <= 0.5 / np.sqrt(2) + 1e-9
    assert figures.shortest_step_mm == pytest.approx(0.5)
    assert figures.sharpest_corner_deg == pytest.approx(90.0)


def test_the_gap_agrees_with_every_pixel_against_every_segment() -> None:
    random = np.random.default_rng(5)
    path = ToolPath(random.uniform(0, 6, 40), random.uniform(0, 4, 40))
    x, y = pixels(0.2)
    starts = np.column_stack([path.x_mm[:-1], path.y_mm[:-1]])
    moves = np.column_stack([np.diff(path.x_mm), np.diff(path.y_mm)])
    points = np.column_stack([x, y])
    ends = zip(starts, moves, strict=True)
    each = [distances_mm(points, np.tile(start, (x.size, 1)), np.tile(move, (x.size, 1))) for start, move in ends]
    exact = float(np.min(each, axis=0).max())
    found = path_figures(path, (x, y)).largest_gap_mm
    assert found is not None
    assert exact <= found <= exact + 0.01


@pytest.mark.parametrize(
    ("path", "corner"),
    [
        (nodes((0, 0), (1, 0), (2, 0)), 0.0),
        (nodes((0, 0), (1, 0), (2, 1)), 45.0),
        (nodes((0, 0), (1, 0), (0, 1)), 135.0),
        (nodes((0, 0), (1, 0), (0, 0)), 180.0),
        (nodes((0, 0), (1, 0), (1, 0), (1, 1)), 90.0),
        (nodes((0, 0), (1, 0)), 0.0),
        (nodes((0, 0), (0, 0)), 0.0),
    ],
)
def test_corners_are_changes_of_direction_and_repeated_nodes_have_none(path: ToolPath, corner: float) -> None:
    assert path_figures(path).sharpest_corner_deg == pytest.approx(corner)


def test_a_repeated_node_is_a_step_of_zero_and_without_an_area_there_is_no_gap() -> None:
    figures = path_figures(nodes((0, 0), (1, 0), (1, 0), (1, 1)))
    assert figures.shortest_step_mm == 0.0
    assert figures.largest_gap_mm is None


def test_one_pixel_alone_has_its_distance() -> None:
    figures = path_figures(nodes((0, 0), (2, 0)), (np.array([1.0]), np.array([0.7])))
    assert figures.largest_gap_mm == pytest.approx(0.7)
