"""Paths laid over apertures of every shape: what they reach, what they leave out."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from ibfctl.path.figures import path_figures
from ibfctl.path.raster import raster
from ibfctl.planning.aperture import bounding_box, fills_its_box, grown, pixels_of, within_reach
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.paths import make_path
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import SurfaceMap

PIXEL_MM = 0.2
Y, X = np.mgrid[-10:10:101j, -10:10:101j]
TOOL = gaussian(1.6, 4.0, 2.0, PIXEL_MM)
SURFACE = SurfaceMap.centred(np.zeros(X.shape), PIXEL_MM)
OPTIONS = PlanOptions(pitch_mm=0.7, step_mm=0.5)
MASKS = {
    "disc": np.hypot(X, Y) <= 8.0,
    "ring": (np.hypot(X, Y) <= 8.0) & (np.hypot(X, Y) >= 4.0),
    "U": (np.abs(X) < 8) & (np.abs(Y) < 8) & ~((np.abs(X) < 4) & (Y > -4)),
    "two islands": (np.hypot(X - 5, Y - 5) < 3) | (np.hypot(X + 5, Y + 5) < 3),
}


def lay(mask: NDArray[np.bool_], scan_axis: Literal["x", "y"] = "x") -> tuple[NDArray[np.float64], ...]:
    path = make_path(SURFACE, mask, TOOL, PlanOptions(pitch_mm=0.7, step_mm=0.5, scan_axis=scan_axis))
    assert path_figures(path, pixels_of(SURFACE, mask)).largest_gap_mm <= 0.5 * 0.7 + 1e-9  # type: ignore[operator]
    return path.x_mm, path.y_mm, path.length_mm


@pytest.mark.parametrize("scan_axis", ["x", "y"])
@pytest.mark.parametrize("shape", MASKS)
def test_a_raster_visits_all_from_where_the_tool_reaches_the_aperture_in_short_steps(
    shape: str, scan_axis: Literal["x", "y"]
) -> None:
    mask = MASKS[shape]
    x_mm, y_mm, length_mm = lay(mask, scan_axis)
    assert np.allclose(np.where(length_mm > 0.6, 0.7, 0.5), length_mm)
    full = raster(grown(bounding_box(SURFACE, mask), TOOL.radius_mm), 0.7, 0.5, scan_axis)
    pixels = np.column_stack(pixels_of(SURFACE, mask))
    every = np.column_stack([full.x_mm, full.y_mm])
    nearest_mm = np.array([np.hypot(*(pixels - node).T).min() for node in every])
    visited = set(zip(np.round(x_mm, 6), np.round(y_mm, 6), strict=True))
    reaching = every[nearest_mm <= TOOL.radius_mm]
    assert all((x, y) in visited for x, y in np.round(reaching, 6))
    assert x_mm.size < full.x_mm.size


def test_a_disc_needs_little_more_than_its_area() -> None:
    x_mm, _, _ = lay(MASKS["disc"])
    assert x_mm.size * 0.7 * 0.5 < 1.12 * np.pi * (8.0 + TOOL.radius_mm) ** 2


def test_a_rectangle_has_its_whole_overrun_with_its_corners() -> None:
    mask = (np.abs(X) < 6) & (np.abs(Y) < 5)
    assert fills_its_box(mask)
    path = make_path(SURFACE, mask, TOOL, OPTIONS)
    full = raster(grown(bounding_box(SURFACE, mask), TOOL.radius_mm), 0.7, 0.5)
    assert np.array_equal(path.x_mm, full.x_mm)
    assert np.array_equal(path.y_mm, full.y_mm)


@pytest.mark.parametrize("shape", MASKS)
def test_reach_is_the_distance_to_the_nearest_pixel(shape: str) -> None:
    mask = MASKS[shape]
    random = np.random.default_rng(4)
    x_mm, y_mm = random.uniform(-14, 14, (2, 30, 20))
    pixels = np.column_stack(pixels_of(SURFACE, mask))
    nearest_mm = np.hypot(x_mm[..., None] - pixels[:, 0], y_mm[..., None] - pixels[:, 1]).min(axis=-1)
    assert np.array_equal(within_reach(SURFACE, mask, x_mm, y_mm, 1.3), nearest_mm <= 1.3)
