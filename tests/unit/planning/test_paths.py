"""Paths laid over apertures of every shape: what they reach, what they leave out."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.path.figures import path_figures
from ibfctl.path.raster import raster
from ibfctl.planning.aperture import bounding_box, grown, is_rectangle, pixels_of, within_reach
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.paths import make_path
from ibfctl.planning.target import Target
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import SurfaceMap
from tests.support.crossings import crossings

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


def target(mask: NDArray[np.bool_], height_nm: NDArray[np.float64] | None = None) -> Target:
    surface = SURFACE if height_nm is None else SurfaceMap.centred(height_nm, PIXEL_MM)
    return Target.of(surface, TOOL, mask, OPTIONS)


def lay(mask: NDArray[np.bool_], scan_axis: Literal["x", "y"] = "x") -> tuple[NDArray[np.float64], ...]:
    path = make_path(SURFACE, target(mask), TOOL, PlanOptions(pitch_mm=0.7, step_mm=0.5, scan_axis=scan_axis))
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
    mask[30:40, 50:53] = False  # dust does not change its outline
    assert is_rectangle(mask)
    path = make_path(SURFACE, target(mask), TOOL, OPTIONS)
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


def test_a_spiral_covers_the_disc_that_holds_the_aperture() -> None:
    mask = MASKS["disc"]
    path = make_path(SURFACE, target(mask), TOOL, replace(OPTIONS, path="spiral"))
    figures = path_figures(path, pixels_of(SURFACE, mask))
    assert figures.largest_gap_mm is not None
    assert figures.largest_gap_mm < 0.56 * 0.7
    reach_mm = np.hypot(path.x_mm, path.y_mm)
    assert 8.0 + TOOL.radius_mm < reach_mm.max() < 8.0 + TOOL.radius_mm + 0.7
    assert reach_mm[0] > reach_mm[-1]
    outwards = make_path(SURFACE, target(mask), TOOL, replace(OPTIONS, path="spiral", inside_out=True))
    assert np.array_equal(outwards.x_mm, path.x_mm[::-1])


@pytest.mark.parametrize("shape", ["disc", "ring", "U"])
def test_a_random_path_covers_every_aperture_and_its_overrun(shape: str) -> None:
    mask = MASKS[shape]
    path = make_path(SURFACE, target(mask), TOOL, replace(OPTIONS, path="random", seed=4))
    figures = path_figures(path, pixels_of(SURFACE, mask))
    assert figures.largest_gap_mm is not None
    assert figures.largest_gap_mm < 1.5 * 0.7
    pixels = np.column_stack(pixels_of(SURFACE, mask))
    nodes = np.column_stack([path.x_mm, path.y_mm])
    nearest_mm = np.hypot(*(nodes[:, None] - pixels[None]).transpose(2, 0, 1)).min(axis=1)
    assert nearest_mm.max() < TOOL.radius_mm + 0.7
    # The overrun is covered as well: the tool may work from all around.
    assert np.percentile(nearest_mm, 95) > 0.8 * TOOL.radius_mm


@pytest.mark.parametrize("seed", [0, 1])
def test_a_random_path_is_denser_where_more_is_to_go(seed: int) -> None:
    mask = (np.abs(X) < 9) & (np.abs(Y) < 6)
    # All counts from the lowest place: the pit in the middle.
    height_nm = np.where(X > 0, 30.0, 5.0) * (np.hypot(X, Y) > 0.5)
    laid = replace(target(mask), height_nm=height_nm[mask])
    path = make_path(SURFACE, laid, TOOL, replace(OPTIONS, path="random", seed=seed, pitch_mm=0.35))
    assert crossings(path) == 0
    inner = (np.abs(path.x_mm) > 2) & (np.abs(path.x_mm) < 9) & (np.abs(path.y_mm) < 6)
    high, low = ((inner & (side * path.x_mm > 0)).sum() for side in (1, -1))
    # 30 against 5, of a mean of 17.3: as dense as 1.73 against a half, the least; less what the lattice rounds away.
    assert 0.8 * 1.73 / 0.5 < high / low <= 1.05 * 1.73 / 0.5


def test_where_nothing_is_to_go_a_random_path_is_even() -> None:
    mask = MASKS["disc"]
    path = make_path(SURFACE, target(mask), TOOL, replace(OPTIONS, path="random"))
    area_mm2 = np.pi * (8.0 + TOOL.radius_mm) ** 2
    assert path.x_mm.size * 0.7**2 == pytest.approx(area_mm2, rel=0.06)


@pytest.mark.parametrize("pitch_mm", [0.0, -1.0, float("nan"), 1e-5])
def test_a_pitch_that_cannot_be_is_refused(pitch_mm: float) -> None:
    with pytest.raises(InputError, match="pitch"):
        make_path(SURFACE, target(MASKS["disc"]), TOOL, replace(OPTIONS, path="random", pitch_mm=pitch_mm))


def test_islands_are_refused_where_the_path_may_not_cross_the_gap() -> None:
    with pytest.raises(InputError, match="separate parts"):
        make_path(SURFACE, target(MASKS["two islands"]), TOOL, replace(OPTIONS, path="random"))


def test_an_aperture_narrower_than_the_pitch_has_a_random_path_all_the_same() -> None:
    mask = np.hypot(X, Y) <= 0.5
    path = make_path(SURFACE, target(mask), TOOL, replace(OPTIONS, path="random", pitch_mm=3.0))
    assert path.x_mm.size >= 3
