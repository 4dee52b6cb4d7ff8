"""The interior point method for small jobs: the optimum of scipy's dense reference, with and without upper bounds."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from ibfctl.dwell.compression import compress
from ibfctl.dwell.interior import first_point, solve_interior
from ibfctl.dwell.solver import DwellProblem
from ibfctl.errors import CancelledError
from tests.support.dwell_problem import make_problem

TIKHONOV, SMOOTHING, PRICE = 1e-2, 1e-2, 0.05


def _reference(problem: DwellProblem, removal: np.ndarray, target: np.ndarray) -> np.ndarray:
    n = problem.operator.steps
    changes = np.diff(np.eye(n), axis=0)[problem.joined]
    rows = np.vstack([removal, np.sqrt(TIKHONOV) * np.eye(n), np.sqrt(SMOOTHING / 4) * changes])
    # A price moves the centre of the Tikhonov term.
    wanted = np.concatenate([target, np.full(n, -PRICE / np.sqrt(TIKHONOV)), np.zeros(len(changes))])
    return np.asarray(lsq_linear(rows, wanted, (problem.lower_s, problem.upper_s), method="bvls", tol=1e-13).x)


@pytest.mark.parametrize("upper_s", [np.inf, 0.3, "some"])
def test_the_times_are_the_references(upper_s: float | str) -> None:
    problem = make_problem(0.01, np.inf if upper_s == "some" else float(upper_s))
    if upper_s == "some":
        problem.upper_s[::2] = 0.2
    small = compress(problem)
    assert small is not None
    solution = solve_interior(
        problem,
        small,
        tikhonov=TIKHONOV,
        smoothing=SMOOTHING,
        price_nm2_s=PRICE,
        start=first_point(problem, 1.0, PRICE),
        tolerance=1e-11,
    )
    expected = _reference(problem, small.removal, small.target)
    assert solution.gap_share < 1e-11
    assert solution.time_s == pytest.approx(expected, abs=1e-5 * expected.max())
    assert (solution.time_s >= problem.lower_s).all()
    assert (solution.time_s <= problem.upper_s).all()
    if upper_s != np.inf:
        assert (expected >= problem.upper_s - 1e-9).mean() > 0.05


def test_bounds_that_coincide_leave_no_choice() -> None:
    problem = make_problem(0.2, 0.2)
    small = compress(problem)
    assert small is not None
    start = first_point(problem, 1.0, PRICE)
    solution = solve_interior(problem, small, tikhonov=0.0, smoothing=0.0, price_nm2_s=PRICE, start=start)
    assert (solution.time_s == 0.2).all()


def test_it_can_be_cancelled() -> None:
    problem = make_problem(0.01, np.inf)
    small = compress(problem)
    assert small is not None
    start = first_point(problem, 1.0, PRICE)
    with pytest.raises(CancelledError):
        solve_interior(
            problem, small, tikhonov=0.0, smoothing=0.0, price_nm2_s=PRICE, start=start, cancelled=lambda: True
        )
