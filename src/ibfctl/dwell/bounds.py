"""Dwell bounds of a machine whose speed ramps linearly, and how fast such a machine should be driven.

Between two path points the stage changes its speed with constant acceleration and then keeps it. Bounds that hold for
whatever speed the step before ended with keep every speed between the slowest and the fastest one (Zhang et al. 2021,
Int. J. Precis. Eng. Manuf.-Green Tech. 8, Eqs. 5 to 20).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError, LimitsError

FloatArray = NDArray[np.float64]

# Shares of the characteristic speed between which the fastest speed is advised to lie (Zhang et al., section 4.2.3).
ADVISED_SHARES = (0.6, 0.8)


@dataclass(frozen=True)
class SpeedRamp:
    """What the stage is allowed along the path.

    Attributes
    ----------
    v_min_mm_s, v_max_mm_s
        Slowest and fastest speed; the slowest is positive: the tool never rests.
    a_mm_s2
        Acceleration of the linear ramp between two speeds.
    """

    v_min_mm_s: float
    v_max_mm_s: float
    a_mm_s2: float

    def __post_init__(self) -> None:
        if not (0 < self.v_min_mm_s < self.v_max_mm_s < math.inf):
            raise InputError(
                f"dwell bounds: speeds from {self.v_min_mm_s:g} to {self.v_max_mm_s:g} mm/s are no range",
                "give a slowest speed above zero and below the fastest",
            )
        if not 0 < self.a_mm_s2 < math.inf:
            raise InputError(f"dwell bounds: acceleration is {self.a_mm_s2:g} mm/s², it must be positive", "correct it")


@dataclass(frozen=True)
class DwellBounds:
    """Shortest and longest time of each step.

    Attributes
    ----------
    lower_s, upper_s : (n,) float64
    """

    lower_s: FloatArray
    upper_s: FloatArray


def accelerating_bounds(step_mm: FloatArray, ramp: SpeedRamp) -> DwellBounds:
    """Bounds for steps (n,) that speed up: from the slowest to at most the fastest speed (Eq. 12)."""
    return DwellBounds((step_mm + _lost_mm(ramp)) / ramp.v_max_mm_s, step_mm / ramp.v_min_mm_s)


def decelerating_bounds(step_mm: FloatArray, ramp: SpeedRamp) -> DwellBounds:
    """Bounds for steps (n,) that slow down: from the fastest to at least the slowest speed (Eq. 16)."""
    return DwellBounds(step_mm / ramp.v_max_mm_s, (step_mm - _lost_mm(ramp)) / ramp.v_min_mm_s)


def dwell_bounds(step_mm: FloatArray, ramp: SpeedRamp) -> DwellBounds:
    """Bounds for steps (n,) that may do either (Eq. 17).

    Raises
    ------
    LimitsError
        If some step is too short for the whole range of speeds (Eqs. 18 and 19).
    """
    reached = characteristic_speed_mm_s(step_mm, ramp.a_mm_s2, ramp.v_min_mm_s / ramp.v_max_mm_s)
    if (reached < ramp.v_max_mm_s * (1 - 1e-12)).any():
        shortest = int(np.argmin(step_mm))
        raise LimitsError(
            f"dwell bounds: {ramp.v_max_mm_s:g} mm/s is above the characteristic speed {reached.min():.4g} mm/s "
            f"of step {shortest} ({step_mm[shortest]:.4g} mm)",
            f"drive at {ADVISED_SHARES[0]:g} to {ADVISED_SHARES[1]:g} of it, or take longer steps",
        )
    speeding, slowing = accelerating_bounds(step_mm, ramp), decelerating_bounds(step_mm, ramp)
    return DwellBounds(speeding.lower_s, slowing.upper_s)


def characteristic_speed_mm_s(step_mm: FloatArray, a_mm_s2: float | FloatArray, ratio: float) -> FloatArray:
    """Fastest speed (n,) for which the bounds of steps (n,) leave a choice (Eq. 20).

    Parameters
    ----------
    a_mm_s2
        Acceleration along the steps; one, or (n,).
    ratio
        Slowest over fastest speed, at least 0 and below 1.
    """
    return np.asarray(np.sqrt(2 * step_mm * a_mm_s2 / (1 - ratio**2)))


def advised_speeds_mm_s(step_mm: float, a_mm_s2: float, ratio: float) -> tuple[float, float]:
    """Range in which to set the fastest speed: accurate, and still quick."""
    speed_mm_s = float(characteristic_speed_mm_s(np.array(step_mm), a_mm_s2, ratio))
    return ADVISED_SHARES[0] * speed_mm_s, ADVISED_SHARES[1] * speed_mm_s


def _lost_mm(ramp: SpeedRamp) -> float:
    """How much farther the tool would come at the speed after a full ramp than it does on the ramp."""
    return (ramp.v_max_mm_s - ramp.v_min_mm_s) ** 2 / (2 * ramp.a_mm_s2)
