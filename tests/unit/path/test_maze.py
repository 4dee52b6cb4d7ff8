"""The maze visits every node once, in unit steps, without a preferred direction."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.errors import InputError
from ibfctl.path.maze import cell_centres, maze
from ibfctl.path.tool_path import ToolPath
from ibfctl.surface.map import Rectangle

AREA = Rectangle(-3.0, 5.0, 2.0, 8.0)
PITCH_MM = 0.5


def grid_steps(path: ToolPath, pitch_mm: float = PITCH_MM) -> np.ndarray:
    """Steps (2, n) in pitches."""
    return np.stack([np.diff(path.x_mm), np.diff(path.y_mm)]) / pitch_mm


@pytest.mark.parametrize("area", [AREA, Rectangle(0, 0.5, 0, 20), Rectangle(0, 20, 0, 0.5), Rectangle(0, 0.1, 0, 0.1)])
@pytest.mark.parametrize("seed", [0, 7])
def test_every_node_once_in_steps_of_one_pitch_over_the_whole_area(area: Rectangle, seed: int) -> None:
    path = maze(area, PITCH_MM, seed)
    nodes = np.round(np.stack([path.x_mm - path.x_mm.min(), path.y_mm - path.y_mm.min()]) / PITCH_MM).astype(int)
    columns, rows = nodes.max(axis=1) + 1
    assert nodes.shape[1] == columns * rows
    assert np.unique(nodes, axis=1).shape[1] == columns * rows
    steps = np.abs(grid_steps(path))
    np.testing.assert_allclose(np.sort(steps, axis=0), np.repeat([[0.0], [1.0]], steps.shape[1], axis=1), atol=1e-9)
    assert path.x_mm.min() <= area.x0_mm + 1e-9
    assert path.x_mm.max() >= area.x1_mm - 1e-9
    assert path.y_mm.min() <= area.y0_mm + 1e-9
    assert path.y_mm.max() >= area.y1_mm - 1e-9


def test_the_end_is_beside_the_start() -> None:
    path = maze(AREA, PITCH_MM, 3)
    assert np.hypot(path.x_mm[-1] - path.x_mm[0], path.y_mm[-1] - path.y_mm[0]) == pytest.approx(PITCH_MM)


def test_a_seed_is_a_path() -> None:
    one, same, other = maze(AREA, PITCH_MM, 5), maze(AREA, PITCH_MM, 5), maze(AREA, PITCH_MM, 6)
    assert np.array_equal(one.x_mm, same.x_mm)
    assert np.array_equal(one.y_mm, same.y_mm)
    assert not np.array_equal(one.x_mm, other.x_mm)


def test_no_direction_is_preferred() -> None:
    along_x = np.mean([np.abs(grid_steps(maze(Rectangle(0, 20, 0, 20), 0.5, seed))[0]).mean() for seed in range(8)])
    assert along_x == pytest.approx(0.5, abs=0.02)


def test_a_masked_region_is_walked_and_nothing_else() -> None:
    x_mm, y_mm = cell_centres(AREA, PITCH_MM)
    middle_x, middle_y = x_mm.mean(), y_mm.mean()
    radius_mm = np.hypot(x_mm[None, :] - middle_x, y_mm[:, None] - middle_y)
    allowed = (radius_mm < 3.2) & (radius_mm > 1.2)  # a ring: a hole in the middle
    path = maze(AREA, PITCH_MM, 2, allowed)
    assert path.x_mm.size == 4 * allowed.sum()
    column = np.round((path.x_mm - x_mm[0]) / (2 * PITCH_MM) - 0.01).astype(int)
    row = np.round((path.y_mm - y_mm[0]) / (2 * PITCH_MM) - 0.01).astype(int)
    visited = np.zeros(allowed.shape, dtype=int)
    np.add.at(visited, (row, column), 1)
    assert np.array_equal(visited, 4 * allowed)
    np.testing.assert_allclose(np.abs(grid_steps(path)).sum(axis=0), 1.0, atol=1e-9)


def test_one_cell_is_a_square() -> None:
    allowed = np.zeros([part.size for part in reversed(cell_centres(AREA, PITCH_MM))], dtype=bool)
    allowed[2, 3] = True
    path = maze(AREA, PITCH_MM, 0, allowed)
    assert path.x_mm.size == 4
    assert np.abs(grid_steps(path)).sum() == pytest.approx(3)


@pytest.mark.parametrize("places", [[], [(0, 0), (5, 5)], [(0, 0), (1, 1)]], ids=["empty", "apart", "corner to corner"])
def test_a_region_that_does_not_hang_together_is_refused(places: list[tuple[int, int]]) -> None:
    allowed = np.zeros([part.size for part in reversed(cell_centres(AREA, PITCH_MM))], dtype=bool)
    for place in places:
        allowed[place] = True
    with pytest.raises(InputError, match="separate parts"):
        maze(AREA, PITCH_MM, 0, allowed)


@pytest.mark.parametrize("pitch_mm", [0.0, -1.0, float("nan"), float("inf")])
def test_a_pitch_that_is_none_is_refused(pitch_mm: float) -> None:
    with pytest.raises(InputError, match="pitch"):
        maze(AREA, pitch_mm)


def test_a_pitch_that_would_fill_the_memory_is_refused() -> None:
    with pytest.raises(InputError, match="more than"):
        maze(AREA, 1e-3)
