"""The path that the options ask for, over the clear aperture and an overrun by the tool's radius."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.path.from_file import read_nodes
from ibfctl.path.maze import cell_centres, maze
from ibfctl.path.random_adaptive import random_adaptive
from ibfctl.path.raster import raster, raster_places
from ibfctl.path.spiral import spiral
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.aperture import bounding_box, grown, is_rectangle, pixels_of, within_reach
from ibfctl.planning.density import local_pitch
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.target import Target
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import Rectangle, SurfaceMap


def make_path(surface: SurfaceMap, target: Target, influence: InfluenceFunction, options: PlanOptions) -> ToolPath:
    """Lay the path over the clear aperture of the target and its overrun."""
    if isinstance(options.path, Path):
        return read_nodes(options.path)
    mask, radius_mm, (pitch_mm, step_mm) = target.clear_aperture, influence.radius_mm, options.spacing_mm
    area = grown(bounding_box(surface, mask), radius_mm)
    match options.path:
        case "raster":
            return _raster(surface, mask, radius_mm, area, options)
        case "maze":
            x_mm, y_mm = np.meshgrid(*cell_centres(area, pitch_mm))
            allowed = within_reach(surface, mask, x_mm, y_mm, radius_mm + np.sqrt(2) * pitch_mm)
            return maze(area, pitch_mm, options.seed, allowed)
        case "spiral":
            middle_mm = 0.5 * (area.x0_mm + area.x1_mm), 0.5 * (area.y0_mm + area.y1_mm)
            x_mm, y_mm = pixels_of(surface, mask)
            rim_mm = float(np.hypot(x_mm - middle_mm[0], y_mm - middle_mm[1]).max()) + np.sqrt(0.5) * surface.pixel_mm
            return spiral(middle_mm, rim_mm + radius_mm, pitch_mm, step_mm, inside_out=options.inside_out)
        case "random":
            return random_adaptive(*local_pitch(surface, target, influence, pitch_mm), options.seed)
    raise InputError(f"path {options.path!r} cannot be laid", "choose raster, maze, spiral, random, or a file of nodes")


def _raster(
    surface: SurfaceMap, mask: NDArray[np.bool_], radius_mm: float, area: Rectangle, options: PlanOptions
) -> ToolPath:
    """Lay a raster; over anything but a rectangle, only where the tool reaches the clear aperture."""
    spacings = *options.spacing_mm, options.scan_axis
    if is_rectangle(mask):
        return raster(area, *spacings)
    along, across = np.meshgrid(*raster_places(area, *spacings))
    x_mm, y_mm = (along, across) if options.scan_axis == "x" else (across, along)
    reach_mm = radius_mm + np.sqrt(0.5) * surface.pixel_mm
    return raster(area, *spacings, needed=within_reach(surface, mask, x_mm, y_mm, reach_mm))
