"""The classic chain, for comparison: non-negative least squares first, the machine's limits afterwards.

What the limits change is not corrected any more; solving within the bounds is what `solver` does instead
(Zhang et al. 2021, Int. J. Precis. Eng. Manuf.-Green Tech. 8, section 4.2.1 and Table 1).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.solver import Cancelled, Descent, DwellProblem, Regularisation, never

FloatArray = NDArray[np.float64]

ITERATIONS = 800


@dataclass(frozen=True)
class ClassicTimes:
    """What the two stages of the classic chain give.

    Attributes
    ----------
    unlimited_s : (n,) float64
        Non-negative least squares alone.
    time_s : (n,) float64
        The same, cut to the bounds of the machine.
    """

    unlimited_s: FloatArray
    time_s: FloatArray


def nnls_then_limits(
    problem: DwellProblem,
    start_s: FloatArray,
    regularisation: Regularisation | None = None,
    iterations: int = ITERATIONS,
    cancelled: Cancelled = never,
) -> ClassicTimes:
    """Solve a problem without its bounds but for zero, and apply them to the answer.

    Parameters
    ----------
    problem
        Its bounds are the machine's.
    start_s : (n,) float64
        Where to start.
    regularisation
        None for none.
    iterations
        At most so many steps of the solver.

    Raises
    ------
    CancelledError
        When the planning was cancelled.
    """
    n = problem.operator.steps
    unlimited = replace(problem, lower_s=np.zeros(n), upper_s=np.full(n, np.inf))
    descent = Descent(unlimited, regularisation or Regularisation(0.0, 0.0), start_s, cancelled)
    descent.advance(0.0, iterations, 1e-7)
    return ClassicTimes(descent.time_s, np.clip(descent.time_s, problem.lower_s, problem.upper_s))
