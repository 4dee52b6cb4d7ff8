"""The shortest time at the floor: how much residual a saved second costs, and where to stop paying.

A price on beam time moves the solution along the curve of residual against total time. From the solution without
a price (the floor) the price is raised until the residual leaves the margin, then narrowed down between.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.solver import Cancelled, DwellProblem, never, solve_bounded

FloatArray = NDArray[np.float64]

# λ relative to the largest eigenvalue of the normal operator: below the noise of any measured map.
TIKHONOV = 1e-8
FLOOR_ITERATIONS = 1500
PRICE_ITERATIONS = 400


@dataclass(frozen=True)
class TradeOffPoint:
    """One solution on the curve.

    Attributes
    ----------
    price_nm2_s : float
        Price of a second in the objective.
    rms_nm, total_time_s : float
        Residual over the clear aperture, and beam time.
    time_s : (n,) float64
        The dwell times.
    """

    price_nm2_s: float
    rms_nm: float
    total_time_s: float
    time_s: FloatArray


@dataclass(frozen=True)
class TradeOff:
    """The curve, from the floor to the shortest time tried, and the point chosen on it."""

    points: tuple[TradeOffPoint, ...]
    chosen: TradeOffPoint


def shortest_at_floor(
    problem: DwellProblem,
    rms_nm: Callable[[FloatArray], float],
    *,
    margin: float,
    start_s: FloatArray,
    tikhonov: float = TIKHONOV,
    searches: int = 9,
    cancelled: Cancelled = never,
) -> TradeOff:
    """Find the shortest dwell times whose residual is within `margin` of the floor.

    Parameters
    ----------
    problem
        What to solve.
    rms_nm
        Residual of dwell times (n,) on the full map.
    margin
        Allowed rise of the residual over the floor, relative.
    start_s : (n,) float64
        Where to start.
    tikhonov
        λ relative to the largest eigenvalue of the normal operator.
    searches
        Solutions with a price, at most.
    """
    curvature = problem.curvature()

    def at(price: float, start: FloatArray, iterations: int) -> TradeOffPoint:
        solution = solve_bounded(
            problem,
            tikhonov=tikhonov * curvature,
            time_weight=price,
            start_s=start,
            iterations=iterations,
            curvature=curvature,
            cancelled=cancelled,
        )
        times = solution.time_s
        return TradeOffPoint(price, rms_nm(times), float(times.sum()), times)

    floor = at(0.0, start_s, FLOOR_ITERATIONS)
    points = [floor]
    allowed = (1 + margin) * floor.rms_nm
    chosen = floor
    # A price at which the whole beam time is worth the margin: the first guess by orders of magnitude.
    price = margin * floor.rms_nm**2 / floor.total_time_s
    too_dear: float | None = None
    for _ in range(searches if margin > 0 else 0):
        point = at(price, chosen.time_s, PRICE_ITERATIONS)
        points.append(point)
        if point.rms_nm <= allowed:
            chosen = point if point.total_time_s < chosen.total_time_s else chosen
            price = 4 * price if too_dear is None else float(np.sqrt(price * too_dear))
        else:
            too_dear = price
            price = float(np.sqrt(max(chosen.price_nm2_s, price / 16) * price))
        if too_dear is not None and chosen.rms_nm > (1 + 0.9 * margin) * floor.rms_nm:
            break
    return TradeOff(tuple(sorted(points, key=lambda point: -point.total_time_s)), chosen)
