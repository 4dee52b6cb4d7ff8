"""Archimedean spiral for round parts: one turn beside the other at constant pitch."""

from __future__ import annotations

import math

import numpy as np

from ibfctl.errors import InputError
from ibfctl.path.raster import MAX_NODES
from ibfctl.path.tool_path import ToolPath

# Share of the pitch by which a step may cut its arc: steps are shorter than asked for where turns are tight.
_CUT_SHARE = 0.05
# Samples per turn of the integral that places the nodes.
_SAMPLES = 180


def spiral(
    centre_mm: tuple[float, float], radius_mm: float, pitch_mm: float, step_mm: float, *, inside_out: bool = False
) -> ToolPath:
    """Cover a disc with a spiral.

    Parameters
    ----------
    centre_mm, radius_mm
        Disc that no point of which may be farther than half a pitch from the spiral, the overrun included.
    pitch_mm, step_mm
        Distance between turns, and at most between nodes.
    inside_out
        Whether it starts in the middle.

    Raises
    ------
    InputError
        If a spacing is not positive or makes too many nodes.
    """
    for name, value in (("pitch", pitch_mm), ("step", step_mm)):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"spiral: {name} is {value:g} mm, it must be positive", f"correct --{name}-mm")
    # From a quarter of a pitch beside the middle to half a pitch beyond the rim.
    turns = max(radius_mm / pitch_mm, 1.0)
    if math.pi * turns * max(radius_mm / step_mm, _SAMPLES / math.pi) > MAX_NODES:
        raise InputError(f"spiral: gives more than {MAX_NODES} nodes", "choose a larger pitch or step; both are in mm")
    angle = np.linspace(0.5 * np.pi, (2 * turns + 1) * np.pi, math.ceil(_SAMPLES * turns) + 1)
    climb_mm = pitch_mm / (2 * np.pi)
    reach_mm = climb_mm * angle
    per_node = np.minimum(step_mm / np.hypot(reach_mm, climb_mm), np.sqrt(8 * _CUT_SHARE * pitch_mm / reach_mm))
    count = np.concatenate([[0.0], np.cumsum(np.diff(angle) * 0.5 * (1 / per_node[1:] + 1 / per_node[:-1]))])
    places = np.interp(np.linspace(0.0, count[-1], math.ceil(count[-1]) + 1), count, angle)
    if not inside_out:
        places = places[::-1]
    reach_mm = climb_mm * places
    return ToolPath(centre_mm[0] + reach_mm * np.cos(places), centre_mm[1] + reach_mm * np.sin(places))
