"""Rounded corners of a planned path: the pieces that are walked, and how gently."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.machine.description import MachineDescription
from ibfctl.path.smoothing_pieces import SmoothedPath, smoothed_path
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.scheduler import PvtSchedule
from ibfctl.schedule.smoothed import balanced, schedule_smoothed

# Counts that a corner tolerance must be worth at the least.
_LEAST_COUNTS = 10


@dataclass(frozen=True)
class Rounded:
    """A path whose corners are rounded for the machine.

    Attributes
    ----------
    smoothed
        The path in pieces.
    a_max_mm_s2
        Accelerations to stay below, by axis letter; None for the machine's limits alone.
    """

    smoothed: SmoothedPath
    a_max_mm_s2: Mapping[str, float] | None = None

    def balanced(self, dwell_s: NDArray[np.float64], machine: MachineDescription) -> Rounded:
        """Share the times of the segments, about (n,) as given, among their pieces for low accelerations."""
        return replace(self, smoothed=balanced(self.smoothed, dwell_s, machine))

    def schedule(self, dwell_s: NDArray[np.float64], machine: MachineDescription) -> PvtSchedule:
        """Schedule times (n,) of the programmed segments."""
        return schedule_smoothed(self.smoothed, dwell_s, machine, a_max_mm_s2=self.a_max_mm_s2)


def rounded(path: ToolPath, machine: MachineDescription, tolerance_mm: float, corridor_mm: float) -> Rounded:
    """Round the corners of a path for a machine.

    Parameters
    ----------
    tolerance_mm
        Largest distance of the motion from the programmed path.
    corridor_mm
        As chosen for the path.

    Raises
    ------
    InputError
        If the tolerance is no length, or is finer than the machine's counts resolve.
    """
    count_mm = math.hypot(*(1 / axis.counts_per_mm for axis in machine.axes.values()))
    if not (math.isfinite(tolerance_mm) and tolerance_mm >= _LEAST_COUNTS * count_mm):
        raise InputError(
            f"corner tolerance is {tolerance_mm:g} mm; this machine's counts resolve {_LEAST_COUNTS * count_mm:.2g} mm",
            "correct --corner-tolerance-mm",
        )
    # A node lies within half a count of where it should, on both axes.
    return Rounded(smoothed_path(path, tolerance_mm, corridor_mm, 0.5 * count_mm))
