"""Removal by transform against direct summation, and along cubics against finer sampling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.dwell.deposition import Grid, grid_around, grid_of, spread
from ibfctl.dwell.motion import (
    PREDICTION_POINTS,
    executed_operator,
    executed_removal,
    motion_points,
    points_per_segment,
)
from ibfctl.dwell.operator import RemovalOperator, removal_of_samples
from ibfctl.path.raster import raster
from ibfctl.schedule.certificate import axis_cubics
from ibfctl.schedule.scheduler import PvtSchedule, schedule
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.levelling import rms
from ibfctl.surface.map import Rectangle, SurfaceMap
from tests.property.timed_paths import make_machine

RELATIVE = 1e-12


def lagrange(distance: np.ndarray) -> np.ndarray:
    """Cubic Lagrange kernel at a distance in pixels: piecewise, zero from two pixels on."""
    d = np.abs(distance)
    near = (1 - d**2) * (2 - d) / 2
    far = (1 - d) * (2 - d) * (3 - d) / 6
    return np.where(d < 1, near, np.where(d < 2, far, 0.0))


def direct_sum(grid: Grid, influence: InfluenceFunction, x_mm, y_mm, time_s) -> np.ndarray:
    """Stamp the influence function, interpolated by the Lagrange kernel, at every point."""
    half_y, half_x = (size // 2 for size in influence.rate_nm_s.shape)
    rows, columns = np.arange(-half_y, half_y + 1), np.arange(-half_x, half_x + 1)
    total = np.zeros((grid.ny, grid.nx))
    for x, y, time in zip(x_mm, y_mm, time_s, strict=True):
        down = np.arange(grid.ny) - (y - grid.y0_mm) / grid.pixel_mm
        right = np.arange(grid.nx) - (x - grid.x0_mm) / grid.pixel_mm
        weight_y = lagrange(down[:, None] - rows[None, :])
        weight_x = lagrange(right[:, None] - columns[None, :])
        total += time * (weight_y @ influence.rate_nm_s @ weight_x.T)
    return total


def test_positions_on_pixel_centres_stay_inside_the_deposition_grid() -> None:
    # (x - x0) / pixel is a whole number here but for its last bits, on either side of it.
    grid = Grid(60, 80, 0.1, -4.0, -3.0)
    influence = gaussian(1.6, 20.0, 2.0, 0.1)
    x_mm, y_mm = np.meshgrid(np.linspace(-6.0, 6.0, 121), np.linspace(-5.0, 5.0, 5))
    for first in range(0, 121, 7):
        part = x_mm[:, first : first + 9].ravel(), y_mm[:, first : first + 9].ravel()
        source = grid_around(grid, *part)
        indices, _ = spread(source, *part)
        assert indices.min() >= 0
        assert indices.max() < source.ny * source.nx
        time_s = np.ones(part[0].size)
        operator = RemovalOperator(grid, influence, *part)
        np.testing.assert_allclose(
            operator(time_s), removal_of_samples(grid, influence, *part, time_s), atol=1e-9 * time_s.size
        )


@st.composite
def stamps(draw: st.DrawFn):
    random = np.random.default_rng(draw(st.integers(0, 1_000_000)))
    grid = Grid(draw(st.integers(2, 24)), draw(st.integers(2, 24)), 0.5, -3.0, 1.0)
    points = draw(st.integers(1, 12))
    x_mm, y_mm = random.uniform(-8, 14, size=points), random.uniform(-6, 16, size=points)
    if draw(st.booleans()):  # exactly on pixels, the map's edge and far outside included
        x_mm = grid.x0_mm + grid.pixel_mm * np.round((x_mm - grid.x0_mm) / grid.pixel_mm)
    if draw(st.booleans()):
        y_mm = grid.y0_mm + grid.pixel_mm * np.round((y_mm - grid.y0_mm) / grid.pixel_mm)
    shape = 2 * random.integers(1, 9, size=2) + 1
    influence = InfluenceFunction(random.uniform(0, 5, size=shape), grid.pixel_mm)
    return grid, influence, x_mm, y_mm, random.uniform(0, 3, size=points)


@settings(max_examples=80)
@given(stamps())
def test_removal_by_transform_is_the_direct_sum(case):
    grid, influence, x_mm, y_mm, time_s = case
    expected = direct_sum(grid, influence, x_mm, y_mm, time_s)
    tolerance = RELATIVE * influence.rate_nm_s.sum() * time_s.sum()
    assert np.abs(RemovalOperator(grid, influence, x_mm, y_mm)(time_s) - expected).max() <= tolerance
    assert np.abs(removal_of_samples(grid, influence, x_mm, y_mm, time_s) - expected).max() <= tolerance


@settings(max_examples=30)
@given(st.integers(0, 1_000_000))
def test_removal_of_a_gaussian_is_the_analytic_gaussian_on_and_off_the_grid(seed):
    # At 20 pixels per width cubic interpolation of a Gaussian errs by less than 2e-5 of its peak; the cut at
    # 2.5 widths leaves 3e-8 of it.
    fwhm_mm, peak_nm_s, pixel_mm = 2.0, 7.0, 0.1
    influence = gaussian(fwhm_mm, peak_nm_s, 2.5 * fwhm_mm, pixel_mm)
    random = np.random.default_rng(seed)
    grid = Grid(40, 50, pixel_mm, -2.45, -1.95)
    x_mm, y_mm, time_s = random.uniform(-3, 3, 6), random.uniform(-3, 3, 6), random.uniform(0, 2, 6)
    x, y = grid.x0_mm + pixel_mm * np.arange(50), grid.y0_mm + pixel_mm * np.arange(40)
    squared = (x[None, None, :] - x_mm[:, None, None]) ** 2 + (y[None, :, None] - y_mm[:, None, None]) ** 2
    exact = np.tensordot(time_s, peak_nm_s * np.exp(-4 * np.log(2) * squared / fwhm_mm**2), axes=1)
    removal = RemovalOperator(grid, influence, x_mm, y_mm)(time_s)
    assert np.abs(removal - exact).max() <= 2e-5 * peak_nm_s * time_s.sum()


@pytest.fixture(scope="module")
def executed() -> tuple[PvtSchedule, int, Grid, InfluenceFunction]:
    """A raster of 0.5 mm whose times vary by a factor of ten, on a map of 8 x 6 mm."""
    random = np.random.default_rng(5)
    path = raster(Rectangle(-6.0, 6.0, -5.0, 5.0), 0.5, 0.5)
    dwell_s = 0.03 + 0.3 * random.uniform(size=path.segments) ** 2
    dwell_s[7] = 5.0  # split into pieces
    scheduled = schedule(path, dwell_s, make_machine(), 0.025, stretch=True)
    return scheduled, path.segments, Grid(60, 80, 0.1, -4.0, -3.0), gaussian(1.6, 20.0, 2.0, 0.1)


def test_removal_along_the_cubics_equals_ten_times_finer_sampling(executed):
    scheduled, _, grid, influence = executed
    coarse = executed_removal(scheduled.program, grid, influence)
    fine = executed_removal(scheduled.program, grid, influence, 10 * PREDICTION_POINTS)
    assert points_per_segment(scheduled.program, influence) <= PREDICTION_POINTS
    assert rms(fine) > 20.0
    assert rms(coarse - fine) <= 0.001


def test_removal_along_the_cubics_equals_the_sum_over_the_controllers_samples(executed):
    scheduled, _, grid, influence = executed
    program = scheduled.program
    place = {}
    for coordinate in ("x", "y"):
        axis = program.axis_of(coordinate)
        cubics = axis_cubics(program, axis)
        parts = []
        for segment, samples in enumerate(program.time_samples):
            u = (np.arange(samples) + 0.5) / samples
            h, p = cubics.time_s[segment], cubics.move[segment]
            v0, v1 = cubics.start_velocity[segment], cubics.end_velocity[segment]
            blend = (u**3 - 2 * u**2 + u) * h * v0 + (u**3 - u**2) * h * v1
            parts.append(cubics.start[segment] + (3 * u**2 - 2 * u**3) * p + blend)
        place[coordinate] = np.concatenate(parts) / axis.counts_per_mm
    period_s = np.array([program.sample_period_s])
    by_sample = removal_of_samples(grid, influence, place["x"], place["y"], period_s)
    assert rms(by_sample - executed_removal(scheduled.program, grid, influence)) <= 0.001


def test_the_operator_of_the_executed_times_gives_the_executed_removal(executed):
    scheduled, segments, grid, influence = executed
    operator = executed_operator(scheduled.program, scheduled.source_segment, segments, grid, influence, points=6)
    assert operator.steps == segments
    removal = executed_removal(scheduled.program, grid, influence, points=6)
    assert np.abs(operator(scheduled.segment_time_s) - removal).max() <= 1e-9 * removal.max()


def test_gauss_points_carry_the_whole_time_and_stay_within_the_moves(executed):
    program = executed[0].program
    points = motion_points(program, 4)
    np.testing.assert_allclose(points.time_s.sum(axis=1), program.time_samples * program.sample_period_s, rtol=1e-12)
    for coordinate, place in (("x", points.x_mm), ("y", points.y_mm)):
        axis = program.axis_of(coordinate)
        ends = axis.start_counts + np.concatenate([[0], np.cumsum(axis.increment_counts)])
        low, high = np.sort(np.stack([ends[:-1], ends[1:]]) / axis.counts_per_mm, axis=0)
        assert (place >= low[:, None] - 1e-9).all()
        assert (place <= high[:, None] + 1e-9).all()


@given(st.integers(0, 1_000_000))
@settings(max_examples=30)
def test_time_is_neither_lost_nor_made(seed):
    random = np.random.default_rng(seed)
    influence = gaussian(1.0, 5.0, 2.0, 0.25)
    surface = SurfaceMap.centred(np.zeros((60, 60)), 0.25)
    x_mm, y_mm, time_s = random.uniform(-4, 4, 9), random.uniform(-4, 4, 9), random.uniform(0, 3, 9)
    removal = RemovalOperator(grid_of(surface), influence, x_mm, y_mm)(time_s)
    volume = removal.sum() * surface.pixel_mm**2
    np.testing.assert_allclose(volume, influence.volume_rate_nm_mm2_s * time_s.sum(), rtol=1e-9)
