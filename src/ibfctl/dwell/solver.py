"""Bounded, regularised least squares for dwell times, by accelerated projected gradients.

Minimises  1/2 |target - P A t|² + 1/2 λ |t|² + 1/2 μ |D t|² + w Σ t  with  lower <= t <= upper,  where A is the
removal operator and P takes out the free terms and weighs the cells, so that |·| is an RMS in nm (Zhang et al. 2021,
Int. J. Precis. Eng. Manuf.-Green Tech. 8, Eq. 4, with a price w on beam time and one μ on changes along the path).
Every time has a step of its own, safe by construction: for a removal rate without negative parts, what one application
makes of positive times bounds the curvature. Momentum restarts when it points uphill.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.misfit import Misfit
from ibfctl.dwell.operator import Removal
from ibfctl.errors import CancelledError

FloatArray = NDArray[np.float64]
Cancelled = Callable[[], bool]


# Interpolation weights have small negative parts, which the bounds of the curvature do not count.
_NEGATIVE = 1.05
# Least curvature of a time that a descent believes in, relative to the largest.
LEAST = 0.01


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
        vector = np.ones(self.operator.steps)
        bound = np.inf
        for _ in range(12):
            product = self._normal(vector)
            bound = min(bound, float((product / vector).max()))
            vector = np.maximum(product / product.max(), 1e-9)
        return _NEGATIVE * bound

    @cached_property
    def curvatures(self) -> FloatArray:
        """Curvature (n,) of each time on its own, such that together they bound that of the normal operator, nm²/s².

        For a symmetric matrix H without negative entries and any positive u, diag(H u / u) - H has no negative
        eigenvalue. Where the tool hardly reaches the clear aperture little is seen of a time, and it may move far.
        """
        rows = self._normal(np.ones(self.operator.steps))
        least = LEAST * rows.max()
        vector = np.maximum(rows, least) ** -0.5
        return np.asarray(_NEGATIVE * np.maximum(self._normal(vector) / vector, least))

    def _normal(self, positive: FloatArray) -> FloatArray:
        """Apply the normal operator, without free terms, to values (n,)."""
        weights = np.zeros(self.misfit.mask.shape)
        weights[self.misfit.mask] = self.misfit.root_weight**2
        return self.operator.adjoint(weights * self.operator(positive))


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

    Parameters
    ----------
    problem, regularisation, start_s, cancelled
        What to solve, from where, and who may end it.
    curvature
        That of the problem, where it is known already.
    least
        No time moves as if its curvature were below this share of the largest.

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
        least: float = LEAST,
    ) -> None:
        own = problem.curvatures
        self._curvatures = np.maximum(own, least * own.max())
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
        curvatures = self._curvatures + self._tikhonov + self._smoothing
        for done in range(iterations):
            if self._cancelled():
                raise CancelledError("planning was cancelled", "start it again when wanted")
            ahead = self._ahead
            descent = problem.descent(problem.residual(ahead)) - price_nm2_s
            descent -= self._tikhonov * ahead
            if self._smoothing:
                descent -= self._smoothing * problem.roughness(ahead)
            moved = np.clip(ahead + descent / curvatures, problem.lower_s, problem.upper_s)
            change = moved - self.time_s
            full = ahead - moved
            if (curvatures * full) @ change > 0:
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
