"""Methods of the literature: each answers with times that prove themselves, and knows where it is weak."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls as reference_nnls

from ibfctl.dwell.deposition import Grid
from ibfctl.dwell.methods.extension import extended
from ibfctl.dwell.methods.inverse_filter import inverse_filter
from ibfctl.dwell.methods.nnls import nnls
from ibfctl.dwell.methods.solution import Solution
from ibfctl.dwell.misfit import make_misfit
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import DwellProblem
from ibfctl.errors import CancelledError
from ibfctl.path.raster import raster
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import Rectangle, SurfaceMap

LOWER_S = 0.02


def make_problem(pixels: int = 40, pitch_mm: float = 0.5, overrun_mm: float = 3.0) -> DwellProblem:
    """A bowl with waves under a Gaussian tool, on a raster that overruns it."""
    y, x = np.mgrid[-1 : 1 : pixels * 1j, -1 : 1 : pixels * 1j]
    surface = SurfaceMap.centred(10 * (x**2 + y**2) + 3 * np.cos(5 * x + 3 * y), 0.25)
    tool = gaussian(2.0, 5.0, 3.0, 0.25)
    half_mm = 0.125 * pixels + overrun_mm
    path = raster(Rectangle(-half_mm, half_mm, -half_mm, half_mm), pitch_mm, pitch_mm)
    misfit = make_misfit(surface, np.ones(x.shape, dtype=bool), tool, "tilt", 1)
    operator = RemovalOperator(misfit.grid, misfit.influence, path.dwell_x_mm, path.dwell_y_mm)
    n = path.segments
    return DwellProblem(operator, misfit, np.full(n, LOWER_S), np.full(n, np.inf), path.straight)


def test_a_solution_is_judged_by_its_problem() -> None:
    problem = make_problem(20, 1.0)
    good = nnls(problem, iterations=5_000, tolerance=1e-10)
    assert good.rms_nm == problem.rms_nm(good.time_s)
    assert good.total_time_s == good.time_s.sum()
    assert good.distance_from_optimum < 1e-6
    assert good.bound_violation_s == 0
    cut = Solution(replace(problem, upper_s=np.full(problem.upper_s.size, 0.5)), good.time_s)
    assert cut.bound_violation_s == pytest.approx(max(good.time_s.max() - 0.5, LOWER_S))
    assert Solution(good.problem, good.time_s * 1.5).distance_from_optimum > 1e-4


def test_nnls_is_the_references() -> None:
    problem = make_problem(24, 1.5, 0.0)
    dense = np.stack([problem.misfit.of(problem.operator(unit)) for unit in np.eye(problem.operator.steps)], axis=1)
    _, norm = reference_nnls(dense, problem.misfit.target)
    found = nnls(problem, iterations=5_000, tolerance=1e-14)
    assert (found.time_s >= 0).all()
    assert found.rms_nm == pytest.approx(norm, rel=1e-6)


def test_a_price_on_time_shortens_nnls() -> None:
    problem = make_problem(20, 1.0)
    free, priced = nnls(problem), nnls(problem, price_nm2_s=1e-3)
    assert priced.total_time_s < 0.9 * free.total_time_s
    assert priced.rms_nm > free.rms_nm


def test_the_inverse_filter_is_nearly_as_good_and_takes_longer() -> None:
    problem = make_problem()
    preview, best = inverse_filter(problem), nnls(problem)
    initial_nm = float(np.linalg.norm(problem.misfit.target))
    assert preview.time_s.min() == pytest.approx(LOWER_S)
    assert preview.bound_violation_s < 1e-12
    assert best.rms_nm < preview.rms_nm < 0.05 * initial_nm
    assert preview.total_time_s > best.total_time_s
    assert preview.distance_from_optimum > best.distance_from_optimum


def test_the_inverse_filter_keeps_upper_bounds_and_hears_a_cancellation() -> None:
    problem = replace(make_problem(20), upper_s=np.full(make_problem(20).upper_s.size, 0.3))
    assert inverse_filter(problem).bound_violation_s < 1e-12
    with pytest.raises(CancelledError):
        inverse_filter(problem, cancelled=lambda: True)


def test_extension_repeats_the_nearest_cell() -> None:
    misfit = make_problem(12).misfit
    g = misfit.grid
    plane = extended(misfit, Grid(g.ny + 6, g.nx + 4, g.pixel_mm, g.x0_mm - 2 * g.pixel_mm, g.y0_mm - 3 * g.pixel_mm))
    inside = misfit.target.reshape(g.ny, g.nx) * g.nx
    np.testing.assert_allclose(plane[3:-3, 2:-2], inside)
    np.testing.assert_allclose(plane[:3, 2:-2], np.tile(inside[0], (3, 1)))
    np.testing.assert_allclose(plane[3:-3, -2:], np.repeat(inside[:, -1:], 2, axis=1))
