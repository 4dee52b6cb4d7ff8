"""The whole curve of residual against beam time, from the floor down to the shortest times that the limits allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.solver import Cancelled, Descent, DwellProblem, Regularisation, never
from ibfctl.dwell.trade_off import Residual, TradeOff, TradeOffPoint

FloatArray = NDArray[np.float64]

POINTS = 20
ITERATIONS = 60
# The cheapest second relative to the price at the chosen point; relative to the dearest where nothing was paid there.
_BELOW_CHOSEN = 0.03
_BELOW_DEAREST = 1e-9


@dataclass(frozen=True)
class TradeOffCurve:
    """Points of which none is better than another in both residual and time.

    Attributes
    ----------
    points
        By rising time and falling residual.
    chosen
        The one of them that the plan takes.
    """

    points: tuple[TradeOffPoint, ...]
    chosen: TradeOffPoint


def walk(
    problem: DwellProblem,
    residual_nm: Residual,
    found: TradeOff,
    *,
    regularisation: Regularisation,
    points: int = POINTS,
    iterations: int = ITERATIONS,
    cancelled: Cancelled = never,
) -> TradeOffCurve:
    """Raise the price of a second from almost nothing until no second is worth it, each solution the next one's start.

    Parameters
    ----------
    problem
        What was solved.
    residual_nm
        RMS of the residual of dwell times (n,) on the full map.
    found
        Floor and chosen point; they are points of the curve unless the walk finds better ones.
    regularisation
        As in the search for them.
    points, iterations
        How many prices, and steps of the solver for each.

    Raises
    ------
    CancelledError
        When the planning was cancelled.
    """
    # At this price the shortest times are the best: no step's first second is worth it.
    dearest = float(problem.descent(problem.residual(problem.lower_s)).max())
    cheapest = _BELOW_CHOSEN * found.chosen.price_nm2_s or _BELOW_DEAREST * dearest
    walked = [found.floor, found.chosen]
    descent = Descent(problem, regularisation, found.floor.time_s, cancelled)
    if dearest > cheapest:
        for price in np.geomspace(cheapest, dearest, points):
            descent.advance(float(price), iterations, 1e-6)
            time_s = descent.time_s
            walked.append(TradeOffPoint(float(price), residual_nm(time_s), float(time_s.sum()), time_s))
    best = undominated(walked)
    at_most = found.chosen.total_time_s, found.chosen.rms_nm
    chosen = next(point for point in best if point.total_time_s <= at_most[0] and point.rms_nm <= at_most[1])
    return TradeOffCurve(best, chosen)


def undominated(points: list[TradeOffPoint]) -> tuple[TradeOffPoint, ...]:
    """Return the points, by rising time, that leave less than every shorter one."""
    kept: list[TradeOffPoint] = []
    for point in sorted(points, key=lambda point: (point.total_time_s, point.rms_nm)):
        if not kept or point.rms_nm < kept[-1].rms_nm:
            kept.append(point)
    return tuple(kept)
