"""The smoothest dwell times that still reach a residual."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.solver import Cancelled, Descent, DwellProblem, Regularisation

FloatArray = NDArray[np.float64]

# Weights of changes along the path: where hardly a change is left, and where nothing is seen of the weight.
MOST, LEAST = 1e-2, 1e-7
_ITERATIONS = 150
# The residual grows with about the fifteenth root of the weight: most of the way there, within these factors.
_ROOT = 12
_FURTHEST, _NEAREST = 1 / 16, 0.8


def smoothest(
    problem: DwellProblem,
    residual_nm: Callable[[FloatArray], float],
    allowed_nm: float,
    start_s: FloatArray,
    regularisation: Regularisation,
    cancelled: Cancelled,
) -> tuple[Regularisation, FloatArray]:
    """Lower the weight of changes along the path until the residual is within what is allowed.

    Parameters
    ----------
    problem
        What to solve; on coarse cells, as only the weight is wanted.
    residual_nm
        RMS of the residual of dwell times (n,) on the full map.
    allowed_nm
        The residual to reach.
    start_s : (n,) float64
        Where to start.
    regularisation
        All but the weight.

    Returns
    -------
    regularisation, time_s
        With the weight, and near the times (n,) that go with it. The least weight where the residual is out of reach.
    """
    curvature, weight, time_s = problem.curvature(), MOST, start_s
    while True:
        regularisation = replace(regularisation, smoothing=weight)
        descent = Descent(problem, regularisation, time_s, cancelled, curvature)
        descent.advance(0.0, _ITERATIONS)
        time_s = descent.time_s
        reached_nm = residual_nm(time_s)
        if reached_nm <= allowed_nm or weight <= LEAST:
            return regularisation, time_s
        change = (allowed_nm / reached_nm) ** _ROOT
        weight = max(weight * float(np.clip(change, _FURTHEST, _NEAREST)), LEAST)
