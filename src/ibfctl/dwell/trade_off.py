"""The shortest time at the floor: how much residual a saved second costs, and where to stop paying.

A price on beam time moves the solution along the curve of residual against total time. First the floor is found,
without a price; then the price is steered, while the descent goes on, until the residual sits at the edge of the
margin that is given for a shorter run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.solver import Cancelled, Descent, DwellProblem, Regularisation, never

FloatArray = NDArray[np.float64]
Residual = Callable[[FloatArray], float]


@dataclass(frozen=True)
class Aim:
    """Where on the curve of residual against time a plan is to lie; one of three.

    Attributes
    ----------
    margin
        The shortest time whose residual is within this share of the best.
    max_time_s
        The best residual in this time.
    max_residual_nm
        The shortest time to this residual (RMS).
    """

    margin: float = 0.01
    max_time_s: float | None = None
    max_residual_nm: float | None = None


@dataclass(frozen=True)
class Effort:
    """How long to search: iterations to the floor, then rounds of steering the price."""

    floor_iterations: int = 800
    rounds: int = 24
    iterations_per_round: int = 40


@dataclass(frozen=True)
class TradeOffPoint:
    """One solution on the curve of residual against time.

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
    """The floor, and the point that was aimed at."""

    floor: TradeOffPoint
    chosen: TradeOffPoint


def aim_at(
    problem: DwellProblem,
    residual_nm: Residual,
    aim: Aim,
    *,
    start_s: FloatArray,
    regularisation: Regularisation,
    effort: Effort,
    cancelled: Cancelled = never,
) -> TradeOff:
    """Find the dwell times that `aim` asks for.

    Parameters
    ----------
    problem
        What to solve.
    residual_nm
        RMS of the residual of dwell times (n,) on the full map.
    aim
        Shortest time within a margin of the floor, or within a limit on time or residual.
    start_s : (n,) float64
        Where to start.
    """
    descent = Descent(problem, regularisation, start_s, cancelled)

    def here(price: float) -> TradeOffPoint:
        return TradeOffPoint(price, residual_nm(descent.time_s), float(descent.time_s.sum()), descent.time_s)

    descent.advance(0.0, effort.floor_iterations, 1e-7)
    floor = here(0.0)
    allowed_nm = aim.max_residual_nm or (1 + aim.margin) * floor.rms_nm

    def too_long_or_fine(point: TradeOffPoint) -> bool:
        if aim.max_time_s is not None:
            return point.total_time_s > aim.max_time_s
        return point.rms_nm < allowed_nm

    chosen = floor
    # The price at which the margin is worth a hundredth of the beam time.
    price = max(allowed_nm**2 - floor.rms_nm**2, 1e-4 * floor.rms_nm**2) / (0.01 * floor.total_time_s + 1e-300)
    factor, last = 4.0, None
    for _ in range(effort.rounds):
        descent.advance(price, effort.iterations_per_round)
        point = here(price)
        chosen = _better(point, chosen, aim, allowed_nm)
        dearer = too_long_or_fine(point)
        if last is not None and dearer != last:
            factor = max(np.sqrt(factor), 1.02)
        price, last = price * factor if dearer else price / factor, dearer
    return TradeOff(floor, chosen)


def _better(one: TradeOffPoint, other: TradeOffPoint, aim: Aim, allowed_nm: float) -> TradeOffPoint:
    """The one of two points that serves the aim better."""
    if aim.max_time_s is not None:
        fits = [point for point in (one, other) if point.total_time_s <= aim.max_time_s]
        if len(fits) == 2:
            return min(fits, key=lambda point: point.rms_nm)
        return fits[0] if fits else min((one, other), key=lambda point: point.total_time_s)
    fits = [point for point in (one, other) if point.rms_nm <= allowed_nm]
    if len(fits) == 2:
        return min(fits, key=lambda point: point.total_time_s)
    return fits[0] if fits else min((one, other), key=lambda point: point.rms_nm)
