"""The clear aperture on a map: checked, before anything is computed from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from ibfctl.errors import InputError
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import Rectangle, SurfaceMap
from ibfctl.surface.regions import Region, pixels_in


def clear_aperture_mask(surface: SurfaceMap, region: Region | None) -> NDArray[np.bool_]:
    """Pixels (ny, nx) of the clear aperture that hold data.

    Raises
    ------
    InputError
        If the region is none or holds no data.
    """
    valid = np.isfinite(surface.height_nm)
    if region is None:
        return valid
    mask = valid & pixels_in(region, surface)
    if not mask.any():
        e = surface.extent_mm
        raise InputError(
            f"clear aperture: holds no valid pixel of the map (x {e.x0_mm:g} to {e.x1_mm:g}, "
            f"y {e.y0_mm:g} to {e.y1_mm:g} mm)",
            "correct --clear-aperture; coordinates are mm on the part",
        )
    return mask


def bounding_box(surface: SurfaceMap, mask: NDArray[np.bool_]) -> Rectangle:
    """Outer edges of the pixels of `mask` (ny, nx)."""
    half = 0.5 * surface.pixel_mm
    x, y = surface.x_mm[mask.any(axis=0)], surface.y_mm[mask.any(axis=1)]
    return Rectangle(float(x[0] - half), float(x[-1] + half), float(y[0] - half), float(y[-1] + half))


def pixels_of(surface: SurfaceMap, mask: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coordinates x and y, (m,) each, of the pixels of `mask` (ny, nx)."""
    rows, columns = np.nonzero(mask)
    return surface.x_mm[columns], surface.y_mm[rows]


def grown(area: Rectangle, by_mm: float) -> Rectangle:
    """`area` with a margin on all sides."""
    return Rectangle(area.x0_mm - by_mm, area.x1_mm + by_mm, area.y0_mm - by_mm, area.y1_mm + by_mm)


def is_rectangle(mask: NDArray[np.bool_]) -> bool:
    """Whether the outline of the pixels of `mask` (ny, nx) is a rectangle, whatever holes there are inside."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    box = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return bool(box[[0, -1]].all() and box[:, [0, -1]].all())


def within_reach(
    surface: SurfaceMap,
    mask: NDArray[np.bool_],
    x_mm: NDArray[np.float64],
    y_mm: NDArray[np.float64],
    reach_mm: float,
) -> NDArray[np.bool_]:
    """Whether a pixel of `mask` (ny, nx) has its centre within `reach_mm` of each position; the shape of `x_mm`.

    `reach_mm` must be at least half the diagonal of a pixel.
    """
    row, column = (
        np.rint((place_mm - first_mm) / surface.pixel_mm).astype(np.int64)
        for place_mm, first_mm in ((y_mm, surface.y0_mm), (x_mm, surface.x0_mm))
    )
    on_map = (row >= 0) & (row < mask.shape[0]) & (column >= 0) & (column < mask.shape[1])
    reached = np.zeros(x_mm.shape, dtype=bool)
    reached[on_map] = mask[row[on_map], column[on_map]]
    # From outside, the nearest pixel is on the rim.
    rim = mask & ~ndimage.binary_erosion(mask)
    outside = np.column_stack([x_mm[~reached], y_mm[~reached]])
    distance_mm, _ = cKDTree(np.column_stack(pixels_of(surface, rim))).query(outside, distance_upper_bound=reach_mm)
    reached[~reached] = np.isfinite(distance_mm)
    return reached


def check_sizes(surface: SurfaceMap, influence: InfluenceFunction) -> None:
    """Refuse an influence function that the map cannot resolve or hold.

    Raises
    ------
    InputError
        If the influence function is larger than the map, or narrower than two pixels of it.
    """
    e = surface.extent_mm
    longest_mm = max(e.x1_mm - e.x0_mm, e.y1_mm - e.y0_mm)
    if 2 * influence.radius_mm > longest_mm:
        raise InputError(
            f"influence function: {2 * influence.radius_mm:.3g} mm wide, larger than the map ({longest_mm:.3g} mm)",
            "check the units of both files; a tool larger than the part cannot correct it",
        )
    if influence.radius_mm < surface.pixel_mm:
        raise InputError(
            f"influence function: {2 * influence.radius_mm:.3g} mm wide, less than two pixels of the map "
            f"({surface.pixel_mm:.3g} mm each)",
            "check the units of both files, or measure the map more finely",
        )
