"""The smoothest dwell times that still reach a residual."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.dwell.smoothest import LEAST, MOST, smoothest
from ibfctl.dwell.solver import DwellProblem, Regularisation, never
from ibfctl.errors import CancelledError
from tests.support.dwell_problem import make_problem


@pytest.fixture(scope="module")
def problem() -> DwellProblem:
    return make_problem(0.01, np.inf)


def _search(problem: DwellProblem, share: float) -> tuple[float, np.ndarray]:
    """Allow a share of the residual of the shortest times."""
    allowed_nm = share * problem.rms_nm(problem.lower_s)
    regularisation, time_s = smoothest(
        problem, problem.rms_nm, allowed_nm, problem.lower_s, Regularisation(tikhonov=1e-6), never
    )
    assert regularisation.tikhonov == 1e-6
    return regularisation.smoothing, time_s


def test_the_more_is_allowed_the_smoother(problem: DwellProblem) -> None:
    # The shortest times leave 1; hardly a change of time along the path 0.164, no regard to it 0.152.
    (fine, exact_s), (coarse, even_s) = _search(problem, 0.155), _search(problem, 0.16)
    assert LEAST < fine < coarse < MOST
    assert problem.rms_nm(exact_s) <= 0.155 * problem.rms_nm(problem.lower_s)
    assert problem.rms_nm(even_s) <= 0.16 * problem.rms_nm(problem.lower_s)
    assert even_s @ problem.roughness(even_s) < exact_s @ problem.roughness(exact_s)


def test_what_is_out_of_reach_gets_the_least_weight_and_what_is_free_the_most(problem: DwellProblem) -> None:
    assert _search(problem, 1e-6)[0] == LEAST
    assert _search(problem, 1.0)[0] == MOST


def test_the_search_can_be_cancelled(problem: DwellProblem) -> None:
    with pytest.raises(CancelledError):
        smoothest(problem, problem.rms_nm, 1.0, problem.lower_s, Regularisation(), lambda: True)
