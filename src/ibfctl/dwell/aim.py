"""What a plan aims at on the curve of residual against time, and points on that curve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Share = Callable[[float], None]


def ignored(share: float) -> None:
    """Report progress to nobody."""


@dataclass(frozen=True)
class Aim:
    """Where on the curve of residual against time a plan is to lie; one of four.

    Attributes
    ----------
    margin
        The shortest time whose residual is within this share of the best.
    max_time_s
        The best residual in this time.
    max_residual_nm
        The shortest time to this residual (RMS).
    seconds_per_nm
        What a nanometre of residual is worth: the least of the total time plus so many seconds for each.
    """

    margin: float = 0.01
    max_time_s: float | None = None
    max_residual_nm: float | None = None
    seconds_per_nm: float | None = None


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


def better(one: TradeOffPoint, other: TradeOffPoint, aim: Aim, allowed_nm: float) -> TradeOffPoint:
    """The one of two points that serves the aim better."""
    worth = aim.seconds_per_nm
    if worth is not None:
        return min((one, other), key=lambda point: point.total_time_s + worth * point.rms_nm)
    if aim.max_time_s is not None:
        fits = [point for point in (one, other) if point.total_time_s <= aim.max_time_s]
        if len(fits) == 2:
            return min(fits, key=lambda point: point.rms_nm)
        return fits[0] if fits else min((one, other), key=lambda point: point.total_time_s)
    fits = [point for point in (one, other) if point.rms_nm <= allowed_nm]
    if len(fits) == 2:
        return min(fits, key=lambda point: point.total_time_s)
    return fits[0] if fits else min((one, other), key=lambda point: point.rms_nm)


def in_time(short_s: FloatArray, long_s: FloatArray, max_time_s: float) -> FloatArray:
    """Return the times (n,) on the line between two solutions that take `max_time_s` in all, or the nearer end."""
    shorter, longer = float(short_s.sum()), float(long_s.sum())
    share = (max_time_s - shorter) / (longer - shorter) if longer > shorter else 0.0
    return np.asarray(short_s + min(max(share, 0.0), 1.0) * (long_s - short_s))
