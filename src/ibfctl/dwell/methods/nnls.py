"""Non-negative least squares, alone and with the machine's limits applied afterwards.

What the limits change is not corrected any more; solving within the bounds is what `ibfctl.dwell.solver` does instead
(Zhang et al. 2021, Int. J. Precis. Eng. Manuf.-Green Tech. 8, section 4.2.1 and Table 1).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.methods.solution import Solution
from ibfctl.dwell.solver import Cancelled, Descent, DwellProblem, Regularisation, never

FloatArray = NDArray[np.float64]

ITERATIONS = 800


def nnls(
    problem: DwellProblem,
    start_s: FloatArray | None = None,
    *,
    price_nm2_s: float = 0.0,
    iterations: int = ITERATIONS,
    tolerance: float = 1e-7,
    cancelled: Cancelled = never,
) -> Solution:
    """Solve a problem without its bounds but for zero, and without any regularisation.

    Parameters
    ----------
    start_s : (n,) float64, optional
        Where to start; from nothing by default.
    price_nm2_s
        Weight of the total time in the objective, half the squared RMS in nm².
    iterations, tolerance
        At most so many steps, fewer where they have become this small relative to the longest time.

    Returns
    -------
    Solution
        Of the problem without its bounds.

    Raises
    ------
    CancelledError
        When the planning was cancelled.
    """
    n = problem.operator.steps
    unlimited = replace(problem, lower_s=np.zeros(n), upper_s=np.full(n, np.inf))
    start_s = np.zeros(n) if start_s is None else start_s
    descent = Descent(unlimited, Regularisation(0.0, 0.0), start_s, cancelled)
    descent.advance(price_nm2_s, iterations, tolerance)
    return Solution(unlimited, descent.time_s)


def nnls_then_limits(
    problem: DwellProblem,
    start_s: FloatArray | None = None,
    *,
    iterations: int = ITERATIONS,
    cancelled: Cancelled = never,
) -> Solution:
    """Solve a problem without its bounds, and cut the answer to them: the classic chain.

    Parameters
    ----------
    problem
        Its bounds are the machine's.
    start_s, iterations
        As for `nnls`.

    Raises
    ------
    CancelledError
        When the planning was cancelled.
    """
    free = nnls(problem, start_s, iterations=iterations, cancelled=cancelled)
    return Solution(problem, np.clip(free.time_s, problem.lower_s, problem.upper_s))
