"""A plain two-metric projected Newton method for bounded dwell times, as a peer to measure against.

Of the kind that Zhang et al. 2021 use (Int. J. Precis. Eng. Manuf.-Green Tech. 8, section 3.3; Bertsekas 1982, SIAM J.
Control Optim. 20, 221): times near a bound whose gradient pushes against it take a gradient step, the others a Newton
step by conjugate gradients, and the arc of both that is cut to the bounds is searched by Armijo's rule.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.solver import DwellProblem, Regularisation

FloatArray = NDArray[np.float64]

_SUFFICIENT, _SHORTEST = 1e-4, 1e-8
# Of those tried (0.5, 0.1, 0.01; 30, 100, 300) the quickest on the jobs of the benchmark.
_RESIDUAL_SHARE, _INNER_ITERATIONS = 0.1, 30


@dataclass
class ProjectedNewton:
    """Counts as one application what one step of a gradient method costs: the operator and its adjoint.

    Attributes
    ----------
    time_s : (n,) float64
        Times, within their bounds.
    applications
        Of the operator and its adjoint, so far.
    """

    problem: DwellProblem
    regularisation: Regularisation
    price_nm2_s: float
    time_s: FloatArray
    applications: float = 0.0
    _weights: tuple[float, float] = field(init=False)

    def __post_init__(self) -> None:
        curvature = self.problem.curvature()
        self._curvature = curvature
        self._weights = self.regularisation.tikhonov * curvature, self.regularisation.smoothing * curvature

    def advance(self, applications: int) -> None:
        """Take whole steps until so many applications are used up."""
        lower_s, upper_s = self.problem.lower_s, self.problem.upper_s
        value, slope = self._value_and_slope()
        while self.applications < applications:
            time_s = self.time_s
            moved = np.clip(time_s - slope / self._curvature, lower_s, upper_s)
            near_s = min(1e-3 * float(time_s.max()), float(np.abs(moved - time_s).max()))
            held = ((time_s <= lower_s + near_s) & (slope > 0)) | ((time_s >= upper_s - near_s) & (slope < 0))
            step = np.where(held, -slope / self._curvature, self._newton_step(slope, ~held))
            share = 1.0
            while share > _SHORTEST:
                self.time_s = np.clip(time_s + share * step, lower_s, upper_s)
                expected = -share * float(slope[~held] @ step[~held])
                expected += float(slope[held] @ (time_s - self.time_s)[held])
                if self._value() <= value - _SUFFICIENT * expected:
                    break
                share *= 0.5
            value, slope = self._value_and_slope()

    def _newton_step(self, slope: FloatArray, free: NDArray[np.bool_]) -> FloatArray:
        step, left = np.zeros(slope.size), np.where(free, -slope, 0.0)
        along, size = left.copy(), float(left @ left)
        enough = _RESIDUAL_SHARE**2 * size
        for _ in range(_INNER_ITERATIONS):
            if size <= enough:
                break
            product = np.where(free, self._curved(along), 0.0)
            length = size / float(along @ product)
            step, left = step + length * along, left - length * product
            size, earlier = float(left @ left), size
            along = left + size / earlier * along
        return step

    def _curved(self, values: FloatArray) -> FloatArray:
        self.applications += 1
        problem, (tikhonov, smoothing) = self.problem, self._weights
        product = problem.descent(problem.misfit.of(problem.operator(values)))
        return np.asarray(product + tikhonov * values + smoothing * problem.roughness(values))

    def _value(self) -> float:
        self.applications += 0.5
        return self._objective(self.problem.residual(self.time_s))

    def _value_and_slope(self) -> tuple[float, FloatArray]:
        self.applications += 1
        problem, time_s, (tikhonov, smoothing) = self.problem, self.time_s, self._weights
        residual = problem.residual(time_s)
        slope = -problem.descent(residual) + tikhonov * time_s + smoothing * problem.roughness(time_s)
        return self._objective(residual), np.asarray(slope + self.price_nm2_s)

    def _objective(self, residual: FloatArray) -> float:
        time_s, (tikhonov, smoothing) = self.time_s, self._weights
        return (
            0.5 * float(residual @ residual)
            + 0.5 * tikhonov * float(time_s @ time_s)
            + 0.5 * smoothing * float(time_s @ self.problem.roughness(time_s))
            + self.price_nm2_s * float(time_s.sum())
        )
