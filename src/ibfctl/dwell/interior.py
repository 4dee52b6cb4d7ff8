"""Primal-dual interior point method for small jobs: the exact optimum in some twenty iterations.

Minimises  1/2 |b - M t|² + 1/2 λ |t|² + 1/2 μ |D t|² + w Σ t  with  lower <= t <= upper  for a compressed problem
(r directions, n steps; upper bounds may be infinite). The Newton matrix is M'M plus a tridiagonal part, so a step costs
r² n (Woodbury); predictor and corrector after Mehrotra.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded, lapack

from ibfctl.dwell.compression import CompressedProblem
from ibfctl.dwell.solver import Cancelled, DwellProblem, never
from ibfctl.errors import CancelledError

FloatArray = NDArray[np.float64]

_ITERATIONS = 60
_TO_BOUNDARY = 0.995
# Share of the gap in the objective at which a solution is kept as a start for a neighbouring price.
_WARM_SHARE = 0.05
# Room between bounds that coincide: a thousandth of a sample.
_ROOM_S = 1e-6


@dataclass(frozen=True)
class InteriorPoint:
    """A point inside the bounds, and their multipliers, all positive.

    Attributes
    ----------
    above_s : (n,) float64
        Distances from the lower bounds.
    dual : (n + k,) float64
        Multipliers of the lower bounds, and behind them those of the k finite upper bounds.
    """

    above_s: FloatArray
    dual: FloatArray


def first_point(problem: DwellProblem, typical_s: float, dual: float) -> InteriorPoint:
    """Make a point `typical_s` above the lower bounds where there is room, with all multipliers `dual`."""
    room, top = _room(problem)
    return InteriorPoint(np.minimum(typical_s, 0.5 * room), np.full(room.size + top.size, dual))


@dataclass(frozen=True)
class InteriorSolution:
    """Times and their proof.

    Attributes
    ----------
    time_s : (n,) float64
        Times within their bounds.
    gap_share : float
        Duality gap relative to the objective: how far from the optimum at most.
    warm
        A point on the way from which a neighbouring price is reached in a few iterations.
    """

    time_s: FloatArray
    gap_share: float
    warm: InteriorPoint


def solve_interior(
    problem: DwellProblem,
    compressed: CompressedProblem,
    *,
    tikhonov: float,
    smoothing: float,
    price_nm2_s: float,
    start: InteriorPoint,
    tolerance: float = 1e-4,
    cancelled: Cancelled = never,
) -> InteriorSolution:
    """Solve a small problem.

    Parameters
    ----------
    problem, compressed
        The problem (bounds and straight motions are taken from it) and its compressed form.
    tikhonov, smoothing
        λ and μ in nm²/s².
    price_nm2_s
        w in nm²/s.
    start
        Where to start, strictly inside.
    tolerance
        Duality gap relative to the objective at which to stop.
    """
    rough = _roughness_bands(problem, smoothing)
    matrix, target, lower = compressed.removal, compressed.target, problem.lower_s
    room, top = _room(problem)

    def slack_of(step: FloatArray) -> FloatArray:
        """What a change of the times (n,) changes of the distances (n + k,) from the bounds."""
        return np.concatenate([step, -step[top]])

    def folded(values: FloatArray, sign: float) -> FloatArray:
        """Values of the lower bounds (n,) plus `sign` times those of the upper ones."""
        result = values[: lower.size].copy()
        result[top] += sign * values[lower.size :]
        return result

    above, dual, warm = start.above_s, start.dual, start
    share = np.inf
    for _ in range(_ITERATIONS):
        if cancelled():
            raise CancelledError("planning was cancelled", "start it again when wanted")
        time_s, slack = lower + above, np.concatenate([above, room[top] - above[top]])
        residual = matrix @ time_s - target
        smooth = tikhonov * time_s + smoothing * problem.roughness(time_s)
        gap = float(slack @ dual)
        share = gap / (0.5 * float(residual @ residual + time_s @ smooth) + price_nm2_s * float(time_s.sum()))
        slope = residual @ matrix + smooth + price_nm2_s
        if share > _WARM_SHARE:
            warm = InteriorPoint(above, dual)
        if share < tolerance and np.abs(slope - folded(dual, -1.0)).max() < 1e-3 * price_nm2_s:
            break
        newton = _Newton(matrix, rough, tikhonov + folded(dual / slack, 1.0))
        step = slack_of(newton(-slope))
        dual_step = -dual - dual / slack * step
        reach = min(1.0, _reach(slack, step), _reach(dual, dual_step))
        ahead = float((slack + reach * step) @ (dual + reach * dual_step))
        centre = (ahead / gap) ** 3 * gap / slack.size
        correction = (centre - step * dual_step) / slack
        step = slack_of(newton(folded(correction, -1.0) - slope))
        dual_step = -dual - dual / slack * step + correction
        reach = min(1.0, _TO_BOUNDARY * min(_reach(slack, step), _reach(dual, dual_step)))
        above, dual = above + reach * step[: lower.size], dual + reach * dual_step
    return InteriorSolution(np.clip(lower + above, lower, problem.upper_s), share, warm)


def _room(problem: DwellProblem) -> tuple[FloatArray, NDArray[np.int64]]:
    """Room between the bounds (n,), and the k steps where it is finite."""
    room = np.maximum(problem.upper_s - problem.lower_s, _ROOM_S)
    return room, np.flatnonzero(np.isfinite(room))


class _Newton:
    """Solves (M'M + T) x = v with T = diag + tridiagonal, by T's banded Cholesky factor and Woodbury's formula."""

    def __init__(self, matrix: FloatArray, rough: FloatArray, diagonal: FloatArray) -> None:
        bands = rough.copy()
        bands[0] += diagonal
        self._factor = cholesky_banded(bands, lower=True, check_finite=False)
        self._half = self._lower(matrix.T)
        normal = self._half.T @ self._half
        normal[np.diag_indices_from(normal)] += 1
        self._inverse = np.linalg.inv(normal)

    def _lower(self, values: FloatArray) -> FloatArray:
        """Solve L x = values for the Cholesky factor L of T."""
        return np.asarray(lapack.dtbtrs(self._factor, values, uplo="L")[0])

    def __call__(self, values: FloatArray) -> FloatArray:
        half = self._lower(values[:, None])[:, 0]
        half = half - self._half @ (self._inverse @ (self._half.T @ half))
        return np.asarray(lapack.dtbtrs(self._factor, half[:, None], uplo="L", trans="T")[0][:, 0])


def _roughness_bands(problem: DwellProblem, smoothing: float) -> FloatArray:
    """Lower bands (2, n) of the roughness' matrix times `smoothing`."""
    n = problem.lower_s.size
    joined = np.ones(n - 1, dtype=bool) if problem.joined is None else problem.joined
    bands = np.zeros((2, n))
    bands[0, 1:] += joined
    bands[0, :-1] += joined
    bands[1, :-1] = -1.0 * joined
    return bands * (smoothing / 4)


def _reach(values: FloatArray, step: FloatArray) -> float:
    """Longest step that keeps `values` from turning negative."""
    falling = step < 0
    return float((-values[falling] / step[falling]).min()) if falling.any() else np.inf
