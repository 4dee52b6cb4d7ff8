"""How steep dwell times are along a path."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ibfctl.path.tool_path import ToolPath

FloatArray = NDArray[np.float64]


def slope_rms_s_mm(path: ToolPath, time_s: FloatArray) -> float:
    """RMS of the change of dwell time over the distance, between dwell points that follow each other straight on.

    Ke et al. 2022, Opt. Express 30, Eq. 6, over all lines of the path instead of its central one. Zero for a path
    that never goes straight on.
    """
    away_mm = np.hypot(np.diff(path.dwell_x_mm), np.diff(path.dwell_y_mm))
    counted = path.straight & (away_mm > 0)
    if not counted.any():
        return 0.0
    return float(np.sqrt(np.mean((np.diff(time_s)[counted] / away_mm[counted]) ** 2)))
