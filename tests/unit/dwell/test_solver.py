"""The bounded solver: the optimum of scipy's dense reference, by its own conditions and by its objective."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from ibfctl.dwell.solver import Descent, Regularisation
from ibfctl.errors import CancelledError
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.levelling import Levelling
from tests.support.dwell_problem import dense, make_problem

STEPS = 99
REGULARISATION = Regularisation(1e-4, 1e-3)


@pytest.mark.parametrize("upper_s", [np.inf, 0.5])
@pytest.mark.parametrize("price", [0.0, 0.05])
def test_the_objective_is_the_references(upper_s: float, price: float) -> None:
    problem = make_problem(0.01, upper_s)
    descent = Descent(problem, REGULARISATION, problem.lower_s)
    descent.advance(price, 20_000, 1e-13)
    n = problem.operator.steps
    assert n == STEPS - 1
    tikhonov = REGULARISATION.tikhonov * descent.curvature
    smoothing = REGULARISATION.smoothing * descent.curvature
    changes = np.diff(np.eye(n), axis=0)[problem.joined]
    rows = np.vstack([dense(problem), np.sqrt(tikhonov) * np.eye(n), np.sqrt(smoothing / 4) * changes])
    # A price moves the centre of the Tikhonov term.
    centre = np.full(n, -price / np.sqrt(tikhonov))
    wanted = np.concatenate([problem.misfit.target, centre, np.zeros(len(changes))])
    reference = lsq_linear(rows, wanted, (problem.lower_s, problem.upper_s), method="bvls", tol=1e-13)
    best = reference.cost - 0.5 * centre @ centre
    assert descent.objective(price) == pytest.approx(best, rel=1e-6)
    assert descent.time_s == pytest.approx(reference.x, abs=1e-4 * reference.x.max())
    at_bounds = (descent.time_s == problem.lower_s) | (descent.time_s == problem.upper_s)
    assert 0.1 < at_bounds.mean() < 0.9


def test_at_the_optimum_nothing_can_be_gained_inside_the_bounds() -> None:
    problem = make_problem(0.01, 0.5)
    descent = Descent(problem, REGULARISATION, problem.lower_s)
    descent.advance(0.01, 20_000, 1e-13)
    times = descent.time_s
    slope = (
        0.01
        - problem.descent(problem.residual(times))
        + REGULARISATION.tikhonov * descent.curvature * times
        + REGULARISATION.smoothing * descent.curvature * problem.roughness(times)
    )
    scale = np.abs(slope).max()
    inside = (times > problem.lower_s) & (times < problem.upper_s)
    assert np.abs(slope[inside]).max() < 1e-6 * scale
    assert (slope[times == problem.lower_s] > -1e-6 * scale).all()
    assert (slope[times == problem.upper_s] < 1e-6 * scale).all()


def test_the_bound_of_the_curvature_is_above_the_largest_eigenvalue_and_near_it() -> None:
    measured = gaussian(1.2, 6.0, 1.2, 0.2).rate_nm_s
    noise = 0.02 * np.random.default_rng(4).normal(size=measured.shape)
    for influence in (None, InfluenceFunction(measured + 6 * noise, 0.2)):
        problem = make_problem(0.0, np.inf, influence)
        nothing_free = Levelling(np.zeros((0, problem.misfit.root_weight.size)))
        bare = replace(problem, misfit=replace(problem.misfit, levelling=nothing_free))
        largest = np.linalg.norm(dense(bare), 2) ** 2
        assert largest <= problem.curvature() <= 1.6 * largest


def test_a_price_on_time_buys_time_with_residual() -> None:
    problem = make_problem(0.01, np.inf)
    times, residuals = [], []
    for price in (0.0, 0.01, 0.05, 0.2, 5.0):
        descent = Descent(problem, REGULARISATION, problem.lower_s)
        descent.advance(price, 5000, 1e-12)
        times.append(float(descent.time_s.sum()))
        residuals.append(problem.rms_nm(descent.time_s))
    assert times == sorted(times, reverse=True)
    assert residuals == sorted(residuals)
    assert times[-1] == pytest.approx(problem.lower_s.sum())


@pytest.mark.parametrize("start_s", [-1.0, 0.0, 100.0])
def test_every_start_leads_to_the_same_times_within_the_bounds(start_s: float) -> None:
    problem = make_problem(0.01, 0.5)
    descent = Descent(problem, REGULARISATION, np.full(problem.lower_s.size, start_s))
    descent.advance(0.0, 1)
    assert (descent.time_s >= problem.lower_s).all()
    assert (descent.time_s <= problem.upper_s).all()
    descent.advance(0.0, 20_000, 1e-13)
    expected = Descent(problem, REGULARISATION, problem.lower_s)
    expected.advance(0.0, 20_000, 1e-13)
    assert descent.time_s == pytest.approx(expected.time_s, abs=1e-7)


def test_a_descent_is_cancelled_between_two_steps() -> None:
    problem = make_problem(0.01, np.inf)
    calls = iter([False, False, True])
    descent = Descent(problem, REGULARISATION, problem.lower_s, lambda: next(calls))
    with pytest.raises(CancelledError):
        descent.advance(0.0, 100)
