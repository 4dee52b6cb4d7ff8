"""What an aim asks for, exactly: a handful of optima at different prices, each a warm start for the next."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.aim import Aim, Share, TradeOff, TradeOffPoint, better, in_time
from ibfctl.dwell.compression import CompressedProblem
from ibfctl.dwell.interior import first_point, solve_interior
from ibfctl.dwell.solver import Cancelled, DwellProblem, Regularisation

FloatArray = NDArray[np.float64]
Residual = Callable[[FloatArray], float]

# Price of all beam time, as a share of the squared residual, that hardly moves the floor.
_FREE = 3e-3
# First guess of the price of all beam time, as a share of the squared target.
_FIRST = 3e-6
_SEARCHES = 5
# Where the aim is far away, so many searches and such a stride of the price's logarithm at most.
_MOST_SEARCHES, _LONGEST_STRIDE = 14, 4.0
# The floor is found where a nearly free price no longer lowers it by five per cent, or after three.
_FLOORS = 3
_SETTLED = 0.95
# How close to the allowed residual or time is close enough, relative.
_CLOSE = 1e-3


def aim_exactly(
    problem: DwellProblem,
    small: CompressedProblem,
    residual_nm: Residual,
    aim: Aim,
    regularisation: Regularisation,
    cancelled: Cancelled,
    progress: Share,
) -> TradeOff:
    """Find the dwell times that `aim` asks for, by optima at prices that close in on it."""
    curvature = problem.curvature()
    rate = problem.operator(np.ones(problem.operator.steps))
    typical_s = 3 * float(np.linalg.norm(small.target)) / float(rate.max())
    total_s = typical_s * problem.operator.steps + float(problem.lower_s.sum())
    first = _FIRST * float(small.target @ small.target) / total_s
    warm = first_point(problem, typical_s, first)
    points: list[TradeOffPoint] = []

    def at(price: float) -> TradeOffPoint:
        nonlocal warm
        solution = solve_interior(
            problem,
            small,
            tikhonov=regularisation.tikhonov * curvature,
            smoothing=regularisation.smoothing * curvature,
            price_nm2_s=price,
            start=warm,
            cancelled=cancelled,
        )
        warm = solution.warm
        times = solution.time_s
        progress(min(1.0, (len(points) + 1) / (_SEARCHES + 2)))
        points.append(TradeOffPoint(price, residual_nm(times), float(times.sum()), times))
        return points[-1]

    floor = at(first)
    allowed_nm = aim.max_residual_nm
    if aim.max_time_s is None and aim.seconds_per_nm is None and allowed_nm is None:
        for _ in range(_FLOORS):
            above, floor = floor, at(_FREE * floor.rms_nm**2 / floor.total_time_s)
            if floor.rms_nm > _SETTLED * above.rms_nm:
                break
        allowed_nm = (1 + aim.margin) * floor.rms_nm

    def too_dear(point: TradeOffPoint) -> float:
        """Relative distance to the aim: positive where the price was too high."""
        if aim.seconds_per_nm is not None:
            return point.price_nm2_s * aim.seconds_per_nm / point.rms_nm - 1
        if aim.max_time_s is not None:
            return aim.max_time_s / point.total_time_s - 1
        return point.rms_nm / (allowed_nm or point.rms_nm) - 1

    for search in range(_MOST_SEARCHES):
        distances = [too_dear(point) for point in points]
        enclosed = min(distances) <= 0 < max(distances) or aim.seconds_per_nm is not None
        if any(-_CLOSE <= distance <= 0 for distance in distances) or (enclosed and search >= _SEARCHES):
            break
        cheapest = min(points, key=lambda point: point.price_nm2_s)
        if min(distances) > 0 and cheapest.price_nm2_s < _FREE * cheapest.rms_nm**2 / cheapest.total_time_s:
            break  # that is the floor: more time gains nothing
        if aim.seconds_per_nm is not None:
            # The residual hardly depends on the price: what it asks for is almost the answer.
            at(points[-1].rms_nm / aim.seconds_per_nm)
        else:
            at(_next_price([point.price_nm2_s for point in points], distances))
    if aim.max_time_s is not None:
        chosen = _on_line(problem, points, aim.max_time_s, residual_nm)
        return TradeOff(min(*points, chosen, key=lambda point: point.rms_nm), chosen)
    chosen = points[0]
    for point in points:
        chosen = better(point, chosen, aim, allowed_nm or np.inf)
    return TradeOff(min(floor, chosen, key=lambda point: point.rms_nm), chosen)


def _on_line(
    problem: DwellProblem, points: list[TradeOffPoint], max_time_s: float, residual_nm: Residual
) -> TradeOffPoint:
    """Return the point of the given time between the two solutions that enclose it, or the shortest times and one."""
    longer = [point for point in points if point.total_time_s > max_time_s]
    shorter = [point for point in points if point.total_time_s <= max_time_s]
    if not longer:
        return max(shorter, key=lambda point: point.total_time_s)
    above = min(longer, key=lambda point: point.total_time_s)
    below_s = max(shorter, key=lambda point: point.total_time_s).time_s if shorter else problem.lower_s
    time_s = in_time(below_s, above.time_s, max_time_s)
    return TradeOffPoint(above.price_nm2_s, residual_nm(time_s), float(time_s.sum()), time_s)


def _next_price(prices: list[float], distances: list[float]) -> float:
    """Price at which the distance should be just below zero: secant on its logarithm, ever longer strides outside."""
    order = np.argsort(prices)
    log_price, distance = np.log(np.array(prices))[order], np.array(distances)[order] + 0.5 * _CLOSE
    above = int(np.searchsorted(distance > 0, True))
    if log_price.size == 1 or above in {0, log_price.size}:
        edge = log_price[0] if above == 0 else log_price[-1]
        stride = min(1.5 * 1.3 ** max(log_price.size - 3, 0), _LONGEST_STRIDE)
        return float(np.exp(edge + (-stride if above == 0 else stride)))
    low, high = above - 1, above
    share = -distance[low] / (distance[high] - distance[low])
    return float(np.exp(log_price[low] + np.clip(share, 0.05, 0.95) * (log_price[high] - log_price[low])))
