"""Bounded, regularised least squares for dwell times, by accelerated projected gradients.

Minimises  1/2 |target - P A t|² + 1/2 λ |t|² + w Σ t  with  lower <= t <= upper,  where A is the removal operator
and P takes out the free terms and weighs the cells, so that |·| is an RMS in nm (Zhang et al. 2021, Int. J.
Precis. Eng. Manuf.-Green Tech. 8, Eq. 4, with a price w on beam time). The step is safe by construction: for a
removal rate without negative parts, the largest ratio of one application bounds the curvature
(Collatz and Wielandt). Momentum restarts when it points uphill.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ibfctl.dwell.misfit import Misfit
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.errors import CancelledError

FloatArray = NDArray[np.float64]
Cancelled = Callable[[], bool]


def never() -> bool:
    """Answer that nobody cancelled."""
    return False


@dataclass(frozen=True)
class DwellProblem:
    """One least-squares problem.

    Attributes
    ----------
    operator
        Removal on the cells of `misfit` from the times of n steps.
    misfit
        What is to be removed.
    lower_s, upper_s : (n,) float64
        Bounds of the times.
    roughness : sparse (n, n), optional
        Quadratic penalty on the times, e.g. on differences along the path; its largest eigenvalue is one.
    """

    operator: RemovalOperator
    misfit: Misfit
    lower_s: FloatArray
    upper_s: FloatArray
    roughness: sparse.csr_array | None = None

    def residual(self, time_s: FloatArray) -> FloatArray:
        """Weighted, levelled residual (m,); its norm is the RMS in nm over the cells."""
        return np.asarray(self.misfit.target - self.misfit.of(self.operator(time_s)))

    def rms_nm(self, time_s: FloatArray) -> float:
        """RMS of the residual over the cells of the clear aperture."""
        return float(np.linalg.norm(self.residual(time_s)))

    def descent(self, residual: FloatArray) -> FloatArray:
        """Negative gradient (n,) of half the squared norm of `residual`."""
        return self.operator.adjoint(self.misfit.adjoint(residual))

    def curvature(self) -> float:
        """Upper bound of the largest eigenvalue of the normal operator, in nm²/s²."""
        weights = np.zeros(self.misfit.mask.shape)
        weights[self.misfit.mask] = self.misfit.root_weight**2
        vector = np.ones(self.operator.steps)
        bound = np.inf
        for _ in range(12):
            product = self.operator.adjoint(weights * self.operator(vector))
            floor = 1e-9 * product.max()
            bound = min(bound, float((product / vector).max()))
            vector = np.maximum(product, floor) / product.max()
        return 1.02 * bound


@dataclass(frozen=True)
class DwellSolution:
    """Times and how well they solve the problem.

    Attributes
    ----------
    time_s : (n,) float64
        Times within the bounds.
    objective : float
        Value of the objective, nm².
    optimality : float
        Largest projected gradient step, relative to the largest time: zero at the optimum.
    iterations : int
        Gradient evaluations used.
    """

    time_s: FloatArray
    objective: float
    optimality: float
    iterations: int


def solve_bounded(
    problem: DwellProblem,
    *,
    tikhonov: float,
    smoothing: float = 0.0,
    time_weight: float,
    start_s: FloatArray,
    iterations: int,
    tolerance: float = 1e-6,
    curvature: float | None = None,
    cancelled: Cancelled = never,
) -> DwellSolution:
    """Solve one problem.

    Parameters
    ----------
    tikhonov
        λ in nm²/s².
    time_weight
        w in nm²/s.
    start_s : (n,) float64
        Where to start; clipped to the bounds.
    iterations
        At most so many gradients.
    tolerance
        Stop when a full step would change no time by more than this share of the largest.
    curvature
        Bound from `DwellProblem.curvature`, where it is known already.

    Raises
    ------
    CancelledError
        When `cancelled` answers True.
    """
    lipschitz = (problem.curvature() if curvature is None else curvature) + tikhonov + smoothing
    time_s = np.clip(start_s, problem.lower_s, problem.upper_s)
    ahead, momentum = time_s, 1.0
    step = np.inf
    used = 0
    while used < iterations:
        if used % 32 == 0 and cancelled():
            raise CancelledError("planning was cancelled", "start it again when wanted")
        descent = problem.descent(problem.residual(ahead)) - tikhonov * ahead - time_weight
        if problem.roughness is not None:
            descent -= smoothing * (problem.roughness @ ahead)
        used += 1
        moved = np.clip(ahead + descent / lipschitz, problem.lower_s, problem.upper_s)
        step = float(np.abs(moved - ahead).max()) / max(float(np.abs(moved).max()), 1e-300)
        change = moved - time_s
        if (ahead - moved) @ change > 0:
            momentum = 1.0
        following = 0.5 * (1 + np.sqrt(1 + 4 * momentum**2))
        ahead = moved + (momentum - 1) / following * change
        time_s, momentum = moved, following
        if step < tolerance:
            break
    residual = problem.residual(time_s)
    objective = (
        0.5 * float(residual @ residual) + 0.5 * tikhonov * float(time_s @ time_s) + time_weight * float(time_s.sum())
    )
    return DwellSolution(time_s, objective, step, used)
