"""Serpentine raster over a rectangle, or over the part of it that the tool need visit."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.path.tool_path import FloatArray, ToolPath
from ibfctl.surface.map import Rectangle

MAX_NODES = 4_000_000


def raster(
    area: Rectangle,
    pitch_mm: float,
    step_mm: float,
    scan_axis: Literal["x", "y"] = "x",
    needed: NDArray[np.bool_] | None = None,
) -> ToolPath:
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
    needed : (lines, nodes) bool, optional
        Places (see `raster_places`) that must be visited; all by default. A line then runs from its first to its last
        such place, across what lies between, and on to where the neighbour begins or ends: every step keeps its
        length. Lines without any are left out at both ends; in between they are crossed at right angles.

    Raises
    ------
    InputError
        If a spacing is not positive or makes too many nodes, or no place is needed.
    """
    along, across = raster_places(area, pitch_mm, step_mm, scan_axis)
    line, place = _serpentine(np.ones((across.size, along.size), dtype=bool) if needed is None else needed)
    walked, stepped = along[place], across[line]
    return ToolPath(walked, stepped) if scan_axis == "x" else ToolPath(stepped, walked)


def raster_places(
    area: Rectangle, pitch_mm: float, step_mm: float, scan_axis: Literal["x", "y"]
) -> tuple[FloatArray, FloatArray]:
    """Positions of the nodes along a line, and of the lines across it, that cover `area`."""
    for name, value in (("pitch", pitch_mm), ("step", step_mm)):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"raster: {name} is {value:g} mm, it must be positive", f"correct --{name}-mm")
    extents = (area.x0_mm, area.x1_mm), (area.y0_mm, area.y1_mm)
    walked, stepped = extents if scan_axis == "x" else extents[::-1]
    along, across = _centred(*walked, step_mm), _centred(*stepped, pitch_mm)
    if along.size * across.size > MAX_NODES:
        raise InputError(
            f"raster: {across.size} lines of {along.size} nodes are more than {MAX_NODES} nodes",
            "choose a larger pitch or step; both are in mm",
        )
    return along, across


def _serpentine(needed: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Line and place of every node in order, from the needed ones (lines, nodes)."""
    used = np.flatnonzero(needed.any(axis=1))
    if not used.size:
        raise InputError("raster: no line reaches the clear aperture", "choose a smaller pitch or step")
    part = needed[used[0] : used[-1] + 1]
    first, last = part.argmax(axis=1), part.shape[1] - 1 - part[:, ::-1].argmax(axis=1)
    for empty in np.flatnonzero(~part.any(axis=1)):
        # One place, beside the end of the line before: even lines end high.
        first[empty] = last[empty] = (last if empty % 2 else first)[empty - 1]
    for ends, outer, begin in ((last, np.maximum, 0), (first, np.minimum, 1)):
        # Even lines turn where places are high, odd ones where they are low: neighbours share the outer end.
        pairs = ends[begin : begin + 2 * ((ends.size - begin) // 2)].reshape(-1, 2)
        pairs[:] = outer(pairs[:, :1], pairs[:, 1:])
    count = last - first + 1
    line = np.repeat(np.arange(count.size), count)
    ordinal = np.arange(line.size) - np.repeat(np.cumsum(count) - count, count)
    place = np.where(line % 2, last[line] - ordinal, first[line] + ordinal)
    return used[0] + line, place


def _centred(low_mm: float, high_mm: float, spacing_mm: float) -> FloatArray:
    """Positions at `spacing_mm`, centred on the interval and reaching both of its ends."""
    count = math.ceil((high_mm - low_mm) / spacing_mm - 1e-9)
    if count + 1 > MAX_NODES:
        raise InputError(
            f"raster: spacing {spacing_mm:g} mm gives more than {MAX_NODES} nodes", "choose a larger pitch or step"
        )
    return np.asarray(0.5 * (low_mm + high_mm) + spacing_mm * (np.arange(count + 1) - 0.5 * count), dtype=np.float64)
