"""The serpentine raster covers what it should, in lines of one pitch and steps of one step."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ibfctl.errors import InputError
from ibfctl.path.raster import raster, raster_places
from ibfctl.path.tool_path import ToolPath
from ibfctl.surface.map import Rectangle

AREA = Rectangle(-4.1, 6.3, 1.0, 5.2)
PITCH_MM, STEP_MM = 0.3, 0.4


@pytest.mark.parametrize("scan_axis", ["x", "y"])
@pytest.mark.parametrize(("pitch_mm", "step_mm"), [(0.5, 0.5), (0.3, 1.7), (50.0, 0.1), (0.7, 50.0)])
def test_lines_of_one_pitch_walked_to_and_fro_over_the_whole_area(
    scan_axis: str, pitch_mm: float, step_mm: float
) -> None:
    path = raster(AREA, pitch_mm, step_mm, scan_axis)  # type: ignore[arg-type]
    along, across = (path.x_mm, path.y_mm) if scan_axis == "x" else (path.y_mm, path.x_mm)
    low, high = (AREA.x0_mm, AREA.x1_mm) if scan_axis == "x" else (AREA.y0_mm, AREA.y1_mm)
    lines = np.unique(across)
    per_line = along.size // lines.size
    assert along.size == per_line * lines.size
    np.testing.assert_allclose(np.diff(lines), pitch_mm, rtol=1e-9)
    along, across = along.reshape(-1, per_line), across.reshape(-1, per_line)
    assert (across == across[:, :1]).all()
    assert (np.diff(across[:, 0]) > 0).all()
    direction = np.where(np.arange(lines.size) % 2, -1, 1)[:, None]
    np.testing.assert_allclose(np.diff(along, axis=1) * direction, step_mm, rtol=1e-9)
    # From line to line it goes straight across.
    assert (along[1:, 0] == along[:-1, -1]).all()
    # The area is reached on both sides, by less than a spacing more.
    for reached, (edge0, edge1), spacing in (
        (along, (low, high), step_mm),
        (across, (AREA.y0_mm, AREA.y1_mm) if scan_axis == "x" else (AREA.x0_mm, AREA.x1_mm), pitch_mm),
    ):
        assert edge0 - spacing < reached.min() <= edge0 + 1e-9
        assert edge1 - 1e-9 <= reached.max() < edge1 + spacing
        assert reached.min() + reached.max() == pytest.approx(edge0 + edge1)


def test_a_pitch_that_divides_the_area_ends_on_its_edges() -> None:
    path = raster(Rectangle(0.0, 3.0, -1.0, 1.0), 0.1, 0.1)
    assert np.unique(path.y_mm).size == 21
    assert (path.x_mm.min(), path.x_mm.max()) == pytest.approx((0.0, 3.0))


@pytest.mark.parametrize("value", [0.0, -0.5, float("nan"), float("inf")])
def test_a_spacing_that_is_none_is_refused_by_its_option(value: float) -> None:
    with pytest.raises(InputError, match="pitch") as caught:
        raster(AREA, value, 0.5)
    assert "--pitch-mm" in caught.value.hint
    with pytest.raises(InputError, match="step") as caught:
        raster(AREA, 0.5, value)
    assert "--step-mm" in caught.value.hint


@pytest.mark.parametrize(("pitch_mm", "step_mm"), [(1e-9, 0.5), (0.5, 1e-9), (1e-3, 1e-3)])
def test_a_spacing_that_would_fill_the_memory_is_refused(pitch_mm: float, step_mm: float) -> None:
    with pytest.raises(InputError, match="more than"):
        raster(AREA, pitch_mm, step_mm)


def places(path: ToolPath, scan_axis: Literal["x", "y"]) -> tuple[np.ndarray, np.ndarray]:
    """Line and place of every node."""
    along, across = raster_places(AREA, PITCH_MM, STEP_MM, scan_axis)
    walked, stepped = (path.x_mm, path.y_mm) if scan_axis == "x" else (path.y_mm, path.x_mm)
    line, place = np.rint((stepped - across[0]) / PITCH_MM), np.rint((walked - along[0]) / STEP_MM)
    return line.astype(int), place.astype(int)


@settings(deadline=None)
@given(
    needed=arrays(bool, (len(raster_places(AREA, PITCH_MM, STEP_MM, "x")[1]), 27), elements=st.booleans()),
    rare=st.booleans(),
)
def test_whatever_is_needed_is_visited_once_in_steps_as_on_a_full_raster(needed: np.ndarray, rare: bool) -> None:
    if rare:  # few places on few lines
        needed = needed & (np.add.outer(np.arange(needed.shape[0]), np.arange(needed.shape[1])) % 5 == 0)
    needed[0, 3] = needed[-1, 5] = False
    if needed.sum() < 2:
        needed[1, 1:3] = True
    path = raster(AREA, PITCH_MM, STEP_MM, "x", needed)
    line, place = places(path, "x")
    moves = np.abs(np.stack([np.diff(line), np.diff(place)]))
    assert (moves.sum(axis=0) == 1).all()  # one place along, or one line across
    visits = np.zeros(needed.shape, dtype=int)
    np.add.at(visits, (line, place), 1)
    assert visits.max() == 1
    assert visits[needed].all()
    used = np.flatnonzero(needed.any(axis=1))
    assert (line[0], line[-1]) == (used[0], used[-1])


@pytest.mark.parametrize("scan_axis", ["x", "y"])
def test_a_disc_is_covered_with_what_its_lines_need_and_little_more(scan_axis: Literal["x", "y"]) -> None:
    along, across = raster_places(AREA, PITCH_MM, STEP_MM, scan_axis)
    middle = 0.5 * (along[0] + along[-1]), 0.5 * (across[0] + across[-1])
    needed = np.hypot(along - middle[0], across[:, None] - middle[1]) < 2.0
    path = raster(AREA, PITCH_MM, STEP_MM, scan_axis, needed)
    line, place = places(path, scan_axis)
    assert needed.sum() <= path.x_mm.size <= 1.25 * needed.sum()
    per_line = np.bincount(line, minlength=across.size)
    assert per_line[per_line.size // 2] == needed.sum(axis=1).max()
    assert per_line[0] == per_line[-1] == 0
    assert set(zip(*np.nonzero(needed), strict=True)) <= set(zip(line, place, strict=True))


def test_all_places_needed_is_the_full_raster() -> None:
    along, across = raster_places(AREA, PITCH_MM, STEP_MM, "y")
    full = raster(AREA, PITCH_MM, STEP_MM, "y")
    masked = raster(AREA, PITCH_MM, STEP_MM, "y", np.ones((across.size, along.size), dtype=bool))
    assert np.array_equal(full.x_mm, masked.x_mm)
    assert np.array_equal(full.y_mm, masked.y_mm)


def test_a_raster_that_nothing_needs_is_refused() -> None:
    along, across = raster_places(AREA, PITCH_MM, STEP_MM, "x")
    with pytest.raises(InputError, match="no line reaches"):
        raster(AREA, PITCH_MM, STEP_MM, "x", np.zeros((across.size, along.size), dtype=bool))
