"""A machine's limits on cubics between integers, from closed forms."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ibfctl.machine.description import MachineDescription
from ibfctl.schedule.hermite import Cubics

FloatArray = NDArray[np.float64]

TRAVEL_SLACK_COUNTS = 0.5
"""What rounding to counts may add to motion that keeps the travel."""


def position_range(cubics: Cubics) -> tuple[float, float]:
    """Least and greatest position anywhere on the cubics: at nodes, or where the velocity passes zero."""
    curvature = (cubics.end_acceleration - cubics.start_acceleration) / (2 * cubics.time_s)
    linear, constant = cubics.start_acceleration, cubics.start_velocity
    root = np.sqrt(np.maximum(linear**2 - 4 * curvature * constant, 0.0))
    half = -0.5 * (linear + np.copysign(root, linear))
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = np.stack([half / curvature, constant / half], axis=1)
    inside = np.isfinite(roots) & (roots > 0) & (roots < cubics.time_s[:, None])
    turning = cubics.position(np.where(inside, roots, 0.0))
    everywhere = np.concatenate([turning.ravel(), cubics.start, cubics.start[-1:] + cubics.move[-1:]])
    return float(everywhere.min()), float(everywhere.max())


def keeps_limits(cubics: Mapping[str, Cubics], machine: MachineDescription) -> bool:
    """Whether every axis' motion, in counts and s, keeps its speed, acceleration, jerk and travel."""
    for letter, limits in machine.axes.items():
        axis, scale = cubics[letter], limits.counts_per_mm
        low, high = axis.velocity_range
        ends_mm = sorted(counts / limits.signed_counts_per_mm for counts in position_range(axis))
        slack_mm = TRAVEL_SLACK_COUNTS / scale
        if (
            max(float(high.max()), float(-low.min())) > limits.v_max_mm_s * scale
            or float(axis.peak_acceleration.max()) > limits.a_max_mm_s2 * scale
            or (limits.j_max_mm_s3 is not None and float(np.abs(axis.jerk).max()) > limits.j_max_mm_s3 * scale)
            or ends_mm[0] < limits.travel_min_mm - slack_mm
            or ends_mm[1] > limits.travel_max_mm + slack_mm
        ):
            return False
    return True
