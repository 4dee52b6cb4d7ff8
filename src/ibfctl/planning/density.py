"""How densely a random path is laid: local pitch from local removal, on a lattice over the aperture and its overrun."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ibfctl.dwell.misfit import full_width_mm
from ibfctl.errors import InputError
from ibfctl.path.random_adaptive import LATTICE_PER_DISTANCE, POINTS_DISTANCE
from ibfctl.path.raster import MAX_NODES
from ibfctl.path.scatter import Field
from ibfctl.planning.aperture import bounding_box, grown, within_reach
from ibfctl.planning.target import Target
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]

# Where the removal is this many times its mean or more, the path is this many times as dense; and as much thinner.
SPREAD = 2.0
# Scattered points reach so many of their largest distances beyond the path, to leave it no ragged rim.
_MARGIN = 1.5


def local_pitch(
    surface: SurfaceMap, target: Target, influence: InfluenceFunction, pitch_mm: float
) -> tuple[Field, Field]:
    """Local pitch of a random path of mean pitch `pitch_mm`, and 1 wherever the tool reaches the clear aperture.

    The density (nodes per area) follows the target removal, its lowest place counted as none, between half and twice
    the mean. Removal that the tool cannot resolve is averaged; in the overrun it is that of the nearest pixel.

    Raises
    ------
    InputError
        If the pitch is not positive or makes too many nodes.
    """
    if not (np.isfinite(pitch_mm) and pitch_mm > 0):
        raise InputError(f"random path: pitch is {pitch_mm:g} mm, it must be positive", "correct --pitch-mm")
    mask, slack_mm = target.clear_aperture, np.sqrt(0.5) * surface.pixel_mm
    margin_mm = _MARGIN * POINTS_DISTANCE * pitch_mm * np.sqrt(SPREAD)
    area = grown(bounding_box(surface, mask), influence.radius_mm + margin_mm)
    lattice_mm = POINTS_DISTANCE * pitch_mm / np.sqrt(SPREAD) / LATTICE_PER_DISTANCE
    if (area.x1_mm - area.x0_mm) * (area.y1_mm - area.y0_mm) > MAX_NODES * lattice_mm**2 * LATTICE_PER_DISTANCE:
        raise InputError(
            f"random path: pitch {pitch_mm:g} mm gives about {MAX_NODES // 2} nodes or more", "choose a larger pitch"
        )
    x_mm, y_mm = np.meshgrid(
        np.arange(area.x0_mm, area.x1_mm + lattice_mm, lattice_mm),
        np.arange(area.y0_mm, area.y1_mm + lattice_mm, lattice_mm),
    )
    row, column = (
        np.clip(np.rint((place_mm - first_mm) / surface.pixel_mm).astype(np.int64), 0, count - 1)
        for place_mm, first_mm, count in (
            (y_mm, surface.y0_mm, mask.shape[0]),
            (x_mm, surface.x0_mm, mask.shape[1]),
        )
    )
    density = _density(target, full_width_mm(influence) / surface.pixel_mm)
    local_mm = pitch_mm / np.sqrt(density[row, column])
    reach_mm = influence.radius_mm + slack_mm
    around = within_reach(surface, mask, x_mm, y_mm, reach_mm + margin_mm)
    reached = within_reach(surface, mask, x_mm, y_mm, reach_mm)
    return (
        Field(np.where(around, local_mm, np.nan), lattice_mm, area.x0_mm, area.y0_mm),
        Field(np.where(reached, 1.0, np.nan), lattice_mm, area.x0_mm, area.y0_mm),
    )


def _density(target: Target, width_pixels: float) -> FloatArray:
    """Density (ny, nx) relative to its mean over the clear aperture, averaged over the tool's full width."""
    mask = target.clear_aperture
    removal_nm = target.height_map_nm() - target.height_nm.min()
    nearest = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    averaged_nm = ndimage.gaussian_filter(removal_nm[tuple(nearest)], width_pixels / np.sqrt(8 * np.log(2)))
    mean_nm = averaged_nm[mask].mean()
    if mean_nm <= 0:
        return np.ones(mask.shape)
    return np.asarray(np.clip(averaged_nm / mean_nm, 1 / SPREAD, SPREAD))
