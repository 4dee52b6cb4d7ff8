"""The peer of `solver_newton` reaches the optimum, or it is no peer."""

import numpy as np
import pytest

from benchmarks._projected_newton import ProjectedNewton
from ibfctl.dwell.solver import Descent, Regularisation
from tests.support.dwell_problem import make_problem


@pytest.mark.parametrize("upper_s", [np.inf, 0.3])
def test_both_reach_the_same_times(upper_s: float) -> None:
    problem, regularisation = make_problem(0.01, upper_s), Regularisation(1e-4, 1e-3)
    newton = ProjectedNewton(problem, regularisation, 0.05, problem.lower_s.copy())
    newton.advance(600)
    descent = Descent(problem, regularisation, problem.lower_s)
    descent.advance(0.05, 20_000, 1e-13)
    assert 600 <= newton.applications < 700
    assert newton.time_s == pytest.approx(descent.time_s, abs=1e-6)
    assert (newton.time_s >= problem.lower_s).all()
    assert (newton.time_s <= upper_s).all()
