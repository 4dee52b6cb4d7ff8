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

from ibfctl.dwell.aim import Aim, Share, TradeOff, TradeOffPoint, ignored, in_time
from ibfctl.dwell.compression import compress
from ibfctl.dwell.exact import aim_exactly
from ibfctl.dwell.solver import Cancelled, Descent, DwellProblem, Regularisation, never

__all__ = ["Aim", "Effort", "TradeOff", "TradeOffPoint", "aim_at"]

FloatArray = NDArray[np.float64]
Residual = Callable[[FloatArray], float]

# Price of all beam time, as a share of the squared residual, that hardly moves the floor and keeps times from growing
# for nothing.
_FREE = 3e-3
# First price of all beam time, as a share of the squared residual times the root of the margin.
_FIRST = 4.0
# Rounds times steps and cells that take about a second, and so many rounds that more would change nothing.
_ROUNDS_TIMES_SIZE, _MOST_ROUNDS = 600_000, 60
# Most that a round changes the price by, either way.
_CHANGE = 2.0


@dataclass(frozen=True)
class Effort:
    """How long to search: iterations on coarse cells to start with, then rounds of steering the price on fine ones."""

    starting_iterations: int = 200
    rounds: int = 12
    iterations_per_round: int = 25

    @classmethod
    def affordable(cls, problem: DwellProblem, fewest: int = 12) -> Effort:
        """As long as takes about a second, in no fewer rounds than these."""
        size = problem.operator.steps + problem.misfit.mask.size
        return cls(rounds=min(max(_ROUNDS_TIMES_SIZE // size, fewest), _MOST_ROUNDS))


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
        The same problem on coarser cells, on which a descent starts.
    effort
        How long a descent may be; by default as long as is affordable.
    progress
        Called with the share of the work that is done, 0 to 1.
    """
    # The matrices of a small job are small: on a busy machine BLAS threads wait for each other longer than they work.
    with threadpool_limits(1, "blas"):
        small = compress(problem)
        if small is not None:
            return aim_exactly(problem, small, residual_nm, aim, regularisation, cancelled, progress)
    effort = effort or Effort.affordable(problem)
    if coarse is not None:
        start = Descent(coarse, regularisation, start_s, cancelled)
        start.advance(0.0, effort.starting_iterations, 1e-7)
        start_s = start.time_s
    return _by_descent(problem, residual_nm, aim, start_s, regularisation, effort, cancelled, progress)


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
    """Descend to the floor and to the aim side by side: what both still lack of their optima nearly cancels."""
    to_floor = Descent(problem, regularisation, start_s, cancelled)
    to_aim = Descent(problem, regularisation, start_s, cancelled, to_floor.curvature)
    lowest, price, short_s = 0.0, 0.0, problem.lower_s
    # Finer than the cells hardly anything differs between solutions.
    within_nm2 = residual_nm(to_floor.time_s) ** 2 - problem.rms_nm(to_floor.time_s) ** 2

    def rms_nm(time_s: FloatArray) -> float:
        return float(np.sqrt(max(problem.rms_nm(time_s) ** 2 + within_nm2, 0.0)))

    for part in range(effort.rounds):
        to_floor.advance(lowest, effort.iterations_per_round)
        floor_nm, floor_time_s = rms_nm(to_floor.time_s), float(to_floor.time_s.sum())
        lowest = _FREE * floor_nm**2 / floor_time_s
        price = price or _first_price(aim, floor_nm, floor_time_s)
        to_aim.advance(price, effort.iterations_per_round)
        if aim.max_time_s is None or to_aim.time_s.sum() <= aim.max_time_s:
            short_s = to_aim.time_s
        progress((part + 1) / effort.rounds)
        if part + 1 < effort.rounds:
            change = _steering(aim, price, rms_nm(to_aim.time_s), floor_nm, float(to_aim.time_s.sum()))
            price *= float(np.clip(change, 1 / _CHANGE, _CHANGE))

    def point(time_s: FloatArray, price: float) -> TradeOffPoint:
        return TradeOffPoint(price, residual_nm(time_s), float(time_s.sum()), time_s)

    floor = point(to_floor.time_s, lowest)
    if aim.max_time_s is not None:
        longer_s = to_aim.time_s if short_s is not to_aim.time_s else to_floor.time_s
        return TradeOff(floor, point(in_time(short_s, longer_s, aim.max_time_s), price))
    if aim.seconds_per_nm is not None:
        return TradeOff(floor, point(to_aim.time_s, price))
    allowed_nm = aim.max_residual_nm or (1 + aim.margin) * floor.rms_nm
    within_nm2 = floor.rms_nm**2 - problem.rms_nm(floor.time_s) ** 2
    cells_nm = float(np.sqrt(max(allowed_nm**2 - within_nm2, 0.0)))
    return TradeOff(floor, point(_to_residual(problem, short_s, floor.time_s, cells_nm), price))


def _first_price(aim: Aim, floor_nm: float, total_time_s: float) -> float:
    if aim.seconds_per_nm is not None:
        return floor_nm / aim.seconds_per_nm
    return _FIRST * float(np.sqrt(aim.margin)) * floor_nm**2 / total_time_s


def _steering(aim: Aim, price_nm2_s: float, rms_nm: float, floor_nm: float, total_time_s: float) -> float:
    """Return the factor by which to change the price, from where it has led so far."""
    if aim.seconds_per_nm is not None:
        # Along optima of half the squared residual plus price times time, a nm costs residual over price.
        return rms_nm / aim.seconds_per_nm / price_nm2_s
    if aim.max_time_s is not None:
        return (total_time_s / aim.max_time_s) ** 16
    if aim.max_residual_nm is not None:
        return (aim.max_residual_nm / rms_nm) ** 4
    # The residual grows with the square of the price, but slowly: half of the way there.
    excess = max(rms_nm / floor_nm - 1, 0.0)
    return (aim.margin / excess) ** 0.25 if excess > 0 else _CHANGE


def _to_residual(problem: DwellProblem, short_s: FloatArray, long_s: FloatArray, allowed_nm: float) -> FloatArray:
    """Return the times (n,) on the line from a shorter to a longer solution that first leave `allowed_nm` or less."""
    here, change = problem.residual(short_s), problem.residual(long_s) - problem.residual(short_s)
    # |here + share change|² = allowed²
    a, b, c = float(change @ change), float(here @ change), float(here @ here) - allowed_nm**2
    if c <= 0 or a == 0:
        return short_s
    share = (-b - np.sqrt(max(b * b - a * c, 0.0))) / a
    return np.asarray(short_s + min(max(share, 0.0), 1.0) * (long_s - short_s))
