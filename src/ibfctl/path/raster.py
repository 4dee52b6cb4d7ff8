"""Serpentine raster over a rectangle."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from ibfctl.errors import InputError
from ibfctl.path.tool_path import FloatArray, ToolPath
from ibfctl.surface.map import Rectangle

MAX_NODES = 4_000_000


def raster(area: Rectangle, pitch_mm: float, step_mm: float, scan_axis: Literal["x", "y"] = "x") -> ToolPath:
    """Cover `area` with parallel lines, every other one walked backwards.

    Parameters
    ----------
    area
        What the lines must reach, the overrun included. Lines and nodes lie centred over it; the outermost
        are on its edge or up to one spacing outside.
    pitch_mm, step_mm
        Distance between lines, and between nodes along a line.
    scan_axis
        Axis along which the lines run.
    """
    for name, value in (("pitch", pitch_mm), ("step", step_mm)):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"raster: {name} is {value:g} mm, it must be positive", f"correct --{name}-mm")
    if scan_axis == "x":
        along = _centred(area.x0_mm, area.x1_mm, step_mm)
        across = _centred(area.y0_mm, area.y1_mm, pitch_mm)
    else:
        along = _centred(area.y0_mm, area.y1_mm, step_mm)
        across = _centred(area.x0_mm, area.x1_mm, pitch_mm)
    if along.size * across.size > MAX_NODES:
        raise InputError(
            f"raster: {across.size} lines of {along.size} nodes are more than {MAX_NODES} nodes",
            "choose a larger pitch or step; both are in mm",
        )
    lines = np.tile(along, (across.size, 1))
    lines[1::2] = along[::-1]
    walked, stepped = lines.ravel(), np.repeat(across, along.size)
    return ToolPath(walked, stepped) if scan_axis == "x" else ToolPath(stepped, walked)


def _centred(low_mm: float, high_mm: float, spacing_mm: float) -> FloatArray:
    """Positions at `spacing_mm`, centred on the interval and reaching both of its ends."""
    count = math.ceil((high_mm - low_mm) / spacing_mm - 1e-9)
    if count + 1 > MAX_NODES:
        raise InputError(
            f"raster: spacing {spacing_mm:g} mm gives more than {MAX_NODES} nodes", "choose a larger pitch or step"
        )
    return np.asarray(0.5 * (low_mm + high_mm) + spacing_mm * (np.arange(count + 1) - 0.5 * count), dtype=np.float64)
