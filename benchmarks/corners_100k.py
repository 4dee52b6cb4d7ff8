"""100 000 corners of any angle: time to round them and to predict what a CNC takes for the path.

The path walks steps of half a millimetre, turns by up to 150 degrees either way at every node, and is rounded with 5 %
of a step. The drive is that of Essid et al. 2019, Table 2, sampled every millisecond.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ibfctl.path.smoothing import drive_shares, smooth_corners
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.kinematics import time_corners
from ibfctl.schedule.kinematics_drive import Drive

CORNERS, STEP_MM, TOLERANCE_MM, FEED_MM_S = 100_000, 0.5, 0.025, 50.0
TABLE_2 = Drive(
    (20_000 / 60,) * 2, (1000.0,) * 2, (15_000.0,) * 2, (10_000.0,) * 2, cycle_s=0.008, sampling_factor=0.125
)  # fmt: skip


def run() -> dict[str, Any]:
    """Round and time, once."""
    turns = np.random.default_rng(0).uniform(-1, 1, CORNERS + 1) * np.radians(150)
    direction = np.cumsum(turns)
    moves = STEP_MM * np.stack([np.cos(direction), np.sin(direction)])
    path = ToolPath(*np.concatenate([np.zeros((2, 1)), np.cumsum(moves, axis=1)], axis=1))
    begin = time.perf_counter()
    corners = smooth_corners(path, TOLERANCE_MM, drive_shares(path))
    timing = time_corners(corners, TABLE_2, FEED_MM_S)
    wall_s = time.perf_counter() - begin
    return {
        "metrics": {
            "wall_s": wall_s,
            "corners": int(np.count_nonzero(corners.transition_mm)),
            "largest_deviation_mm": corners.largest_deviation_mm,
            "cycle_time_s": timing.cycle_time_s,
        },
        "targets": {
            "wall_s": {"max": 5.0},
            "corners": {"min": 99_990},
            "largest_deviation_mm": {"max": TOLERANCE_MM},
        },
    }
