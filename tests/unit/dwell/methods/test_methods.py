"""Methods of the literature: each answers with times that prove themselves, and knows where it is weak."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls as reference_nnls
from scipy.sparse.linalg import LinearOperator, lsmr

from ibfctl.dwell.deposition import Grid
from ibfctl.dwell.methods.damped_lsmr import damped_lsmr, krylov_space
from ibfctl.dwell.methods.extension import extended, extended_problem
from ibfctl.dwell.methods.inverse_filter import inverse_filter
from ibfctl.dwell.methods.nnls import nnls, nnls_then_limits
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


def test_damped_lsmr_is_the_references() -> None:
    problem = make_problem(24, 1.0)
    operator = LinearOperator(
        (problem.misfit.target.size, problem.operator.steps),
        matvec=lambda time_s: problem.misfit.of(problem.operator(time_s)),
        rmatvec=lambda values: problem.operator.adjoint(problem.misfit.adjoint(values)),
        dtype=float,
    )
    for iterations, damping in ((1, 0.1), (8, 0.0), (8, 0.3), (10, 0.1)):
        space = krylov_space(problem, iterations)
        reference, *_ = lsmr(operator, problem.misfit.target, damping, atol=0, btol=0, conlim=0, maxiter=iterations)
        np.testing.assert_allclose(space.lsmr(damping), reference, atol=1e-6 * np.abs(reference).max())


def test_the_damping_is_searched_and_times_are_offset_to_be_long_enough() -> None:
    problem = make_problem()
    found = damped_lsmr(problem)
    assert found.bound_violation_s < 1e-12
    assert found.time_s.min() == pytest.approx(LOWER_S)
    # Both leave next to nothing of this map; what is left of the offset costs the factor.
    assert found.rms_nm < 1e-3 * float(np.linalg.norm(problem.misfit.target))
    assert found.rms_nm < 2 * nnls(problem).rms_nm
    space = krylov_space(problem)
    for factor in (1e-4, 1e-2, 1e-1):
        time_s = space.lsmr(factor * space.largest_nm_s)
        assert found.rms_nm <= problem.rms_nm(time_s + LOWER_S - time_s.min()) + 1e-3


def test_an_extended_surface_asks_for_more_than_the_aperture_and_leaves_more_on_it() -> None:
    problem = make_problem()
    plain, wide = damped_lsmr(problem), damped_lsmr(problem, extend=True)
    assert wide.problem is problem
    assert wide.bound_violation_s < 1e-12
    assert extended_problem(problem).misfit.target.size > 1.3 * problem.misfit.target.size
    assert plain.rms_nm < wide.rms_nm < 0.05 * float(np.linalg.norm(problem.misfit.target))


def test_tools_are_offset_each_by_itself() -> None:
    problem = make_problem(24, 1.0)
    half = problem.operator.steps // 2
    found = damped_lsmr(problem, blocks=(slice(0, half), slice(half, None)))
    assert [part.min() for part in np.split(found.time_s, [half])] == pytest.approx([LOWER_S, LOWER_S])


def test_the_search_for_the_damping_can_be_cancelled() -> None:
    with pytest.raises(CancelledError):
        damped_lsmr(make_problem(20), cancelled=lambda: True)


@pytest.mark.parametrize("pixels", [2, 20])
def test_a_flat_map_gets_the_shortest_times(pixels: int) -> None:
    problem = make_problem(pixels, 1.0)
    flat = replace(problem, misfit=replace(problem.misfit, target=np.zeros_like(problem.misfit.target)))
    for found in (
        inverse_filter(flat),
        nnls_then_limits(flat),
        damped_lsmr(flat),
        damped_lsmr(flat, extend=True),
    ):
        np.testing.assert_allclose(found.time_s, LOWER_S)
