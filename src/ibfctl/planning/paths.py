"""The path that the options ask for, over the clear aperture and an overrun by the tool's radius."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ibfctl.errors import InputError
from ibfctl.path.from_file import read_nodes
from ibfctl.path.maze import cell_centres, maze
from ibfctl.path.raster import raster
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.aperture import bounding_box, grown
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
        return raster(area, options.pitch_mm, options.step_mm, options.scan_axis)
    if options.path == "maze":
        return maze(area, options.pitch_mm, options.seed, _near(surface, mask, influence.radius_mm, area, options))
    raise InputError(f"path {options.path!r} cannot be laid", "choose raster, maze, or a file of nodes")


def _near(
    surface: SurfaceMap, mask: NDArray[np.bool_], radius_mm: float, area: Rectangle, options: PlanOptions
) -> NDArray[np.bool_]:
    """Cells of a maze over `area` from which the tool reaches the clear aperture."""
    rows, columns = np.nonzero(mask)
    pixels = np.column_stack([surface.x_mm[columns], surface.y_mm[rows]])
    x_mm, y_mm = cell_centres(area, options.pitch_mm)
    centres = np.column_stack([part.ravel() for part in np.meshgrid(x_mm, y_mm)])
    reach_mm = radius_mm + np.sqrt(2) * options.pitch_mm
    distance_mm, _ = cKDTree(pixels).query(centres, distance_upper_bound=reach_mm)
    return np.asarray(np.isfinite(distance_mm).reshape(y_mm.size, x_mm.size))
