"""Advice on the speed of a machine for a path."""

from __future__ import annotations

import numpy as np

from ibfctl.dwell.bounds import ADVISED_SHARES, characteristic_speed_mm_s
from ibfctl.machine.description import MachineDescription
from ibfctl.path.tool_path import ToolPath


def advised_speeds_mm_s(path: ToolPath, machine: MachineDescription) -> tuple[float, float]:
    """Range in which the top speed is best set for half of the steps of a path, with a slowest speed near zero.

    The acceleration along a step is what the weaker axis allows in that direction.
    """
    length_mm = path.length_mm
    moving = length_mm > 0
    if not moving.any():
        return 0.0, 0.0
    with np.errstate(divide="ignore"):
        along = [
            machine.axis_of(coordinate).a_max_mm_s2 * length_mm[moving] / np.abs(np.diff(nodes_mm)[moving])
            for coordinate, nodes_mm in (("x", path.x_mm), ("y", path.y_mm))
        ]
    speed_mm_s = characteristic_speed_mm_s(length_mm[moving], np.minimum(*along), 0.0)
    low, high = ADVISED_SHARES
    return low * float(np.median(speed_mm_s)), high * float(np.median(speed_mm_s))
