"""The path that the options ask for, over the clear aperture and an overrun by the tool's radius."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.path.from_file import read_nodes
from ibfctl.path.maze import cell_centres, maze
from ibfctl.path.raster import raster, raster_places
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.aperture import bounding_box, fills_its_box, grown, within_reach
from ibfctl.planning.options import PlanOptions
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import Rectangle, SurfaceMap


def make_path(
    surface: SurfaceMap, mask: NDArray[np.bool_], influence: InfluenceFunction, options: PlanOptions
) -> ToolPath:
    """Lay the path over the clear aperture `mask` (ny, nx) and its overrun."""
    if isinstance(options.path, Path):
        return read_nodes(options.path)
    area = grown(bounding_box(surface, mask), influence.radius_mm)
    if options.path == "raster":
        return _raster(surface, mask, influence.radius_mm, area, options)
    if options.path == "maze":
        pitch_mm, _ = options.spacing_mm
        x_mm, y_mm = np.meshgrid(*cell_centres(area, pitch_mm))
        reach_mm = influence.radius_mm + np.sqrt(2) * pitch_mm
        allowed = within_reach(surface, mask, x_mm, y_mm, reach_mm)
        return maze(area, pitch_mm, options.seed, allowed)
    raise InputError(f"path {options.path!r} cannot be laid", "choose raster, maze, or a file of nodes")


def _raster(
    surface: SurfaceMap, mask: NDArray[np.bool_], radius_mm: float, area: Rectangle, options: PlanOptions
) -> ToolPath:
    """Lay a raster; over anything but a rectangle, only where the tool reaches the clear aperture."""
    spacings = *options.spacing_mm, options.scan_axis
    if fills_its_box(mask):
        return raster(area, *spacings)
    along, across = np.meshgrid(*raster_places(area, *spacings))
    x_mm, y_mm = (along, across) if options.scan_axis == "x" else (across, along)
    reach_mm = radius_mm + np.sqrt(0.5) * surface.pixel_mm
    return raster(area, *spacings, needed=within_reach(surface, mask, x_mm, y_mm, reach_mm))
