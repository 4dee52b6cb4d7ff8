"""Advice on the speed of a machine for a path."""

from __future__ import annotations

import numpy as np

from ibfctl.dwell.bounds import ADVISED_SHARES, characteristic_speed_mm_s
from ibfctl.machine.description import MachineDescription
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.bounds import along_path


def advised_speeds_mm_s(path: ToolPath, machine: MachineDescription) -> tuple[float, float]:
    """Range in which the top speed is best set for half of the steps of a path, with a slowest speed near zero.

    The acceleration along a step is what the weaker axis allows in that direction.
    """
    length_mm = path.length_mm
    moving = length_mm > 0
    if not moving.any():
        return 0.0, 0.0
    _, push_mm_s2 = along_path(path, machine)
    speed_mm_s = characteristic_speed_mm_s(length_mm[moving], push_mm_s2[moving], 0.0)
    low, high = ADVISED_SHARES
    return low * float(np.median(speed_mm_s)), high * float(np.median(speed_mm_s))
