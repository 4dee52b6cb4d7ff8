"""Tikhonov factor by the L-curve: where less regularisation begins to cost dwell time and no longer gains residual.

Abscissa is the squared norm of the residual, ordinate that of the times, parameter the factor; the factor is taken at
the point of most pronounced curvature (Zhang et al. 2021, Int. J. Precis. Eng. Manuf.-Green Tech. 8, section 3.2). Both
axes are logarithmic and scaled to the range they cover, as one sees the curve on paper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.solver import Cancelled, Descent, DwellProblem, Regularisation, never

FloatArray = NDArray[np.float64]

# Two factors a decade, from one that smothers every correction to one that none can feel.
FACTORS = tuple(float(factor) for factor in np.logspace(-1, -9, 17))
ITERATIONS = 80
# Points nearer to each other than this share of the picture carry no shape.
_APART = 0.02
# A circle so many times the picture across is a straight line.
_STRAIGHT = 1e6


@dataclass(frozen=True)
class LCurve:
    """Solutions for falling factors.

    Attributes
    ----------
    factor : (k,) float64
        Tikhonov factors relative to the largest eigenvalue of the normal operator, falling.
    residual_nm2, norm_s2 : (k,) float64
        Squared residual (mean over the clear aperture) and squared norm of the times.
    corner : int
        Where the curvature is most pronounced.
    """

    factor: FloatArray
    residual_nm2: FloatArray
    norm_s2: FloatArray
    corner: int

    @property
    def chosen(self) -> float:
        """Factor at the corner."""
        return float(self.factor[self.corner])


def l_curve(
    problem: DwellProblem,
    start_s: FloatArray,
    regularisation: Regularisation,
    *,
    factors: tuple[float, ...] = FACTORS,
    iterations: int = ITERATIONS,
    cancelled: Cancelled = never,
) -> LCurve:
    """Walk down the factors, each solution the start of the next.

    Parameters
    ----------
    problem
        What to solve.
    start_s : (n,) float64
        Where to start.
    regularisation
        Its Tikhonov factor is replaced; the rest holds.
    factors
        Falling Tikhonov factors.
    iterations
        At most so many steps of the solver for each.

    Raises
    ------
    CancelledError
        When the planning was cancelled.
    """
    curvature, time_s = problem.curvature(), start_s
    residual_nm2, norm_s2 = [], []
    for factor in factors:
        descent = Descent(problem, replace(regularisation, tikhonov=factor), time_s, cancelled, curvature)
        descent.advance(0.0, iterations, 1e-6)
        time_s = descent.time_s
        residual_nm2.append(problem.rms_nm(time_s) ** 2)
        norm_s2.append(float(time_s @ time_s))
    residual, norm = np.array(residual_nm2), np.array(norm_s2)
    return LCurve(np.array(factors), residual, norm, most_curved(residual, norm))


def most_curved(residual: FloatArray, norm: FloatArray) -> int:
    """Index of the point at which the curve (k,) turns most sharply from gaining residual to growing times.

    Where it never turns that way, regularisation buys nothing: the last point.
    """
    place = np.column_stack([_unit(np.log(residual)), _unit(np.log(norm))])
    kept = [0]
    for index in range(1, len(place)):
        if np.hypot(*(place[index] - place[kept[-1]])) >= _APART:
            kept.append(index)
    if len(kept) < 3:
        return len(place) - 1
    before, here, after = place[kept[:-2]], place[kept[1:-1]], place[kept[2:]]
    arriving, leaving = here - before, after - here
    turn = arriving[:, 1] * leaving[:, 0] - arriving[:, 0] * leaving[:, 1]
    lengths = np.hypot(*arriving.T) * np.hypot(*leaving.T) * np.hypot(*(after - before).T)
    # Reciprocal radius of the circle through three neighbours, positive where it lies away from the origin.
    curvature = 2 * turn / np.maximum(lengths, 1e-300)
    return kept[int(np.argmax(curvature)) + 1] if curvature.max() > 1 / _STRAIGHT else len(place) - 1


def _unit(values: FloatArray) -> FloatArray:
    """Values scaled to the range from zero to one."""
    span = float(np.ptp(values))
    return (values - values.min()) / span if span > 0 else np.zeros(values.size)
