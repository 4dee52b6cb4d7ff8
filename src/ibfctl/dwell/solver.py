"""Bounded, regularised least squares for dwell times, by accelerated projected gradients.

Minimises  1/2 |target - P A t|² + 1/2 λ |t|² + 1/2 μ |D t|² + w Σ t  with  lower <= t <= upper,  where A is the
removal operator and P takes out the free terms and weighs the cells, so that |·| is an RMS in nm (Zhang et al. 2021,
Int. J. Precis. Eng. Manuf.-Green Tech. 8, Eq. 4, with a price w on beam time and one μ on changes along the path).
The step is safe by construction: for a removal rate without negative parts, the largest ratio of one application
bounds the curvature (Collatz and Wielandt). Momentum restarts when it points uphill.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.misfit import Misfit
from ibfctl.dwell.operator import Removal
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
    joined : (n - 1,) bool, optional
        Whether a step and the next are one straight motion, whose change of time is penalised.
    """

    operator: Removal
    misfit: Misfit
    lower_s: FloatArray
    upper_s: FloatArray
    joined: NDArray[np.bool_] | None = None

    def residual(self, time_s: FloatArray) -> FloatArray:
        """Weighted, levelled residual (m,); its norm is the RMS in nm over the cells."""
        return np.asarray(self.misfit.target - self.misfit.of(self.operator(time_s)))

    def rms_nm(self, time_s: FloatArray) -> float:
        """RMS of the residual over the cells of the clear aperture."""
        return float(np.linalg.norm(self.residual(time_s)))

    def descent(self, residual: FloatArray) -> FloatArray:
        """Negative gradient (n,) of half the squared norm of a levelled `residual` (m,)."""
        return self.operator.adjoint(self.misfit.spread(residual))

    def roughness(self, time_s: FloatArray) -> FloatArray:
        """Gradient (n,) of half the squared changes along the path, divided by four: its curvature is at most one."""
        change = np.diff(time_s)
        if self.joined is not None:
            change = np.where(self.joined, change, 0.0)
        gradient = np.zeros(time_s.size)
        gradient[1:] += change
        gradient[:-1] -= change
        return gradient / 4

    def curvature(self) -> float:
        """Upper bound of the largest eigenvalue of the normal operator, in nm²/s²."""
        weights = np.zeros(self.misfit.mask.shape)
        weights[self.misfit.mask] = self.misfit.root_weight**2
        vector = np.ones(self.operator.steps)
        bound = np.inf
        for _ in range(12):
            product = self.operator.adjoint(weights * self.operator(vector))
            bound = min(bound, float((product / vector).max()))
            vector = np.maximum(product / product.max(), 1e-9)
        # Interpolation weights have small negative parts.
        return 1.05 * bound


@dataclass(frozen=True)
class Regularisation:
    """Weights relative to the largest eigenvalue of the normal operator.

    Attributes
    ----------
    tikhonov
        λ, on the times themselves: below the noise of any measured map by default.
    smoothing
        μ, on changes along straight motion: what a stage would have to do with accelerations.
    """

    tikhonov: float = 1e-8
    smoothing: float = 1e-4


class Descent:
    """Accelerated projected gradient descent on one problem, whose price on time may change on the way.

    Attributes
    ----------
    time_s : (n,) float64
        The present times, within the bounds.
    step : float
        Largest change of a time in the last full step, relative to the largest time: zero at the optimum.
    """

    def __init__(
        self,
        problem: DwellProblem,
        regularisation: Regularisation,
        start_s: FloatArray,
        cancelled: Cancelled = never,
        curvature: float | None = None,
    ) -> None:
        self.curvature = problem.curvature() if curvature is None else curvature
        self._problem, self._cancelled = problem, cancelled
        self._tikhonov = regularisation.tikhonov * self.curvature
        self._smoothing = regularisation.smoothing * self.curvature
        self.time_s = np.clip(start_s, problem.lower_s, problem.upper_s)
        self.step = np.inf
        self._ahead, self._momentum = self.time_s, 1.0

    def advance(self, price_nm2_s: float, iterations: int, tolerance: float = 0.0) -> int:
        """Take up to `iterations` steps with a price on time; return how many were taken.

        Raises
        ------
        CancelledError
            When the planning was cancelled.
        """
        problem = self._problem
        lipschitz = self.curvature + self._tikhonov + self._smoothing
        for done in range(iterations):
            if self._cancelled():
                raise CancelledError("planning was cancelled", "start it again when wanted")
            ahead = self._ahead
            descent = problem.descent(problem.residual(ahead)) - price_nm2_s
            descent -= self._tikhonov * ahead
            if self._smoothing:
                descent -= self._smoothing * problem.roughness(ahead)
            moved = np.clip(ahead + descent / lipschitz, problem.lower_s, problem.upper_s)
            change = moved - self.time_s
            full = ahead - moved
            if full @ change > 0:
                self._momentum = 1.0
            following = 0.5 * (1 + np.sqrt(1 + 4 * self._momentum**2))
            self._ahead = moved + (self._momentum - 1) / following * change
            self.time_s, self._momentum = moved, following
            self.step = float(np.abs(full).max()) / max(float(moved.max()), 1e-300)
            if self.step < tolerance:
                return done + 1
        return iterations

    def objective(self, price_nm2_s: float) -> float:
        """Value of the objective at the present times, nm²."""
        residual, time_s = self._problem.residual(self.time_s), self.time_s
        rough = float(time_s @ self._problem.roughness(time_s))
        return (
            0.5 * float(residual @ residual)
            + 0.5 * self._tikhonov * float(time_s @ time_s)
            + 0.5 * self._smoothing * rough
            + price_nm2_s * float(time_s.sum())
        )
