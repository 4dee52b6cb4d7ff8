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
from threadpoolctl import threadpool_limits

from ibfctl.dwell.aim import Aim, Share, TradeOff, TradeOffPoint, better, ignored
from ibfctl.dwell.compression import compress
from ibfctl.dwell.exact import aim_exactly
from ibfctl.dwell.solver import Cancelled, Descent, DwellProblem, Regularisation, never

__all__ = ["Aim", "Effort", "TradeOff", "TradeOffPoint", "aim_at"]

FloatArray = NDArray[np.float64]
# How much longer the finish may make a run.
_TIME_SLACK = 1.01

Residual = Callable[[FloatArray], float]


@dataclass(frozen=True)
class Effort:
    """How long to search: iterations to the floor, rounds of steering the price, iterations to finish."""

    floor_iterations: int = 500
    rounds: int = 20
    iterations_per_round: int = 25
    finishing_iterations: int = 150


def aim_at(
    problem: DwellProblem,
    residual_nm: Residual,
    aim: Aim,
    *,
    start_s: FloatArray,
    regularisation: Regularisation,
    coarse: DwellProblem | None = None,
    effort: Effort | None = None,
    cancelled: Cancelled = never,
    progress: Share = ignored,
) -> TradeOff:
    """Find the dwell times that `aim` asks for: exactly for small jobs, by a bounded descent for large ones.

    Parameters
    ----------
    problem
        What to solve.
    residual_nm
        RMS of the residual of dwell times (n,) on the full map.
    aim
        Shortest time within a margin of the floor, within a limit on time or residual, or the best balance of both.
    start_s : (n,) float64
        Where a descent starts.
    coarse
        The same problem on coarser cells, on which a descent searches before it finishes on `problem`.
    effort
        How long a descent may be.
    progress
        Called with the share of the work that is done, 0 to 1.
    """
    # The matrices of a small job are small: on a busy machine BLAS threads wait for each other longer than they work.
    with threadpool_limits(1, "blas"):
        small = compress(problem)
        if small is not None:
            return aim_exactly(problem, small, residual_nm, aim, regularisation, cancelled, progress)
    effort = effort or Effort()
    if coarse is None:
        return _by_descent(problem, residual_nm, aim, start_s, regularisation, effort, cancelled, progress)
    found = _by_descent(coarse, residual_nm, aim, start_s, regularisation, effort, cancelled, progress)
    return _finished(problem, found, residual_nm, regularisation, effort, cancelled)


def _finished(
    problem: DwellProblem,
    found: TradeOff,
    residual_nm: Residual,
    regularisation: Regularisation,
    effort: Effort,
    cancelled: Cancelled,
) -> TradeOff:
    """Finish on the finer cells, at the price that the coarser ones have led to."""
    chosen = found.chosen
    descent = Descent(problem, regularisation, chosen.time_s, cancelled)
    descent.advance(chosen.price_nm2_s, effort.finishing_iterations, 1e-7)
    time_s = descent.time_s
    finer = TradeOffPoint(chosen.price_nm2_s, residual_nm(time_s), float(time_s.sum()), time_s)
    # On finer cells more is seen: take it unless it costs what was aimed at.
    keep = finer.rms_nm <= chosen.rms_nm and finer.total_time_s <= chosen.total_time_s * _TIME_SLACK
    return TradeOff(found.floor, finer if keep else chosen)


def _by_descent(
    problem: DwellProblem,
    residual_nm: Residual,
    aim: Aim,
    start_s: FloatArray,
    regularisation: Regularisation,
    effort: Effort,
    cancelled: Cancelled,
    progress: Share,
) -> TradeOff:
    descent = Descent(problem, regularisation, start_s, cancelled)

    def here(price: float) -> TradeOffPoint:
        return TradeOffPoint(price, residual_nm(descent.time_s), float(descent.time_s.sum()), descent.time_s)

    for part in range(effort.rounds):
        descent.advance(0.0, -(-effort.floor_iterations // effort.rounds), 1e-7)
        if descent.step < 1e-7:
            break
        progress(0.5 * (part + 1) / effort.rounds)
    floor = here(0.0)
    allowed_nm = aim.max_residual_nm or (1 + aim.margin) * floor.rms_nm

    def too_long_or_fine(point: TradeOffPoint) -> bool:
        if aim.seconds_per_nm is not None:
            # Along optima of half the squared residual plus price times time, a nm costs residual over price.
            return point.price_nm2_s * aim.seconds_per_nm < point.rms_nm
        if aim.max_time_s is not None:
            return point.total_time_s > aim.max_time_s
        return point.rms_nm < allowed_nm

    chosen = floor
    # The price at which the margin is worth a hundredth of the beam time.
    price = max(allowed_nm**2 - floor.rms_nm**2, 1e-4 * floor.rms_nm**2) / (0.01 * floor.total_time_s + 1e-300)
    if aim.seconds_per_nm is not None:
        price = floor.rms_nm / aim.seconds_per_nm
    factor, last = 4.0, None
    for part in range(effort.rounds):
        descent.advance(price, effort.iterations_per_round)
        point = here(price)
        chosen = better(point, chosen, aim, allowed_nm)
        dearer = too_long_or_fine(point)
        if last is not None and dearer != last:
            factor = max(np.sqrt(factor), 1.02)
        progress(0.5 + 0.5 * (part + 1) / effort.rounds)
        price, last = price * factor if dearer else price / factor, dearer
    return TradeOff(floor, chosen)
