"""An influence function from what a tool has left: maps before and after it stood still for a known time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ibfctl.errors import InputError
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]

_MAX_OFFSET_PIXELS = 0.02
_ROUNDS, _SETTLED_PIXELS = 20, 0.1
_MIN_SURROUNDINGS_SHARE = 0.1
# The footprint ends where the mean over a ring is lost in the noise of that mean, or below this share of the peak.
_SIGNIFICANT, _NEGLIGIBLE_SHARE = 3.0, 0.002
_FAINTEST_PEAK = 3.0
_LARGEST_VOLUME_ERROR, _FAINT_PEAK = 0.02, 10.0


@dataclass(frozen=True)
class Footprint:
    """A measured influence function and how far it can be trusted.

    Attributes
    ----------
    influence
        Centred on the footprint, zero beyond its radius.
    x_mm, y_mm, radius_mm
        Where the footprint is on the maps, and where it ends.
    noise_nm
        Standard deviation of the difference of the maps around the footprint, levelled.
    volume_error
        Standard deviation of the volume rate that this noise makes, relative to the volume rate.
    noise_dominates
        Whether the volume rate, which sets the scale of all dwell times, or the shape is too uncertain to plan with.
    """

    influence: InfluenceFunction
    x_mm: float
    y_mm: float
    radius_mm: float
    noise_nm: float
    volume_error: float
    noise_dominates: bool


def footprint(before: SurfaceMap, after: SurfaceMap, dwell_s: float, radius_mm: float | None = None) -> Footprint:
    """Find the footprint in the difference of two maps.

    Parameters
    ----------
    before, after
        On the same pixels; what has gone is before minus after.
    dwell_s
        How long the tool stood there.
    radius_mm
        Where the footprint ends; by default where it is lost in noise.

    Raises
    ------
    InputError
        If the maps do not fit each other, or no footprint with room around it is found.
    """
    if not (np.isfinite(dwell_s) and dwell_s > 0):
        raise InputError(f"dwell time is {dwell_s:g} s, it must be positive", "correct --dwell-s")
    if radius_mm is not None and not (np.isfinite(radius_mm) and radius_mm > before.pixel_mm):
        raise InputError(f"radius is {radius_mm:g} mm, it must be more than a pixel", "correct --radius-mm")
    _refuse_other_pixels(before, after)
    pixel_mm = before.pixel_mm
    removed_nm = before.height_nm - after.height_nm
    valid = np.isfinite(removed_nm)
    row, column = _roughly(removed_nm, valid)
    radius = 0.25 * min(removed_nm.shape) if radius_mm is None else radius_mm / pixel_mm
    for _ in range(_ROUNDS):
        rows, columns = np.ogrid[: removed_nm.shape[0], : removed_nm.shape[1]]
        distance = np.hypot(rows - row, columns - column)
        levelled_nm, noise_nm = _levelled(removed_nm, valid & (distance > radius), valid)
        ends = radius if radius_mm is not None else _end(levelled_nm, valid, distance, noise_nm)
        place = _centre(levelled_nm, valid & (distance <= ends))
        moved = max(abs(ends - radius), abs(place[0] - row), abs(place[1] - column))
        radius, (row, column) = ends, place
        if moved < _SETTLED_PIXELS:
            break
    rate_nm_s = _around(levelled_nm, row, column, radius) / dwell_s
    inside, outside = int((distance <= radius).sum()), int((valid & (distance > radius)).sum())
    peak_nm = float(rate_nm_s.max() * dwell_s)
    if peak_nm < _FAINTEST_PEAK * noise_nm or not rate_nm_s.sum() > 0:
        raise InputError(
            f"footprint: nothing stands out of the noise of {noise_nm:.3g} nm between the maps",
            "check their order, let the tool stand longer, or average more measurements",
        )
    influence = InfluenceFunction(rate_nm_s, pixel_mm)
    # Of the pixels themselves, and of the level that the surroundings give.
    volume_noise = noise_nm / dwell_s * pixel_mm**2 * np.sqrt(inside + inside**2 / outside)
    volume_error = float(volume_noise / influence.volume_rate_nm_mm2_s)
    return Footprint(
        influence,
        float(before.x0_mm + column * pixel_mm),
        float(before.y0_mm + row * pixel_mm),
        float(radius * pixel_mm),
        noise_nm,
        volume_error,
        volume_error > _LARGEST_VOLUME_ERROR or peak_nm < _FAINT_PEAK * noise_nm,
    )


def _refuse_other_pixels(before: SurfaceMap, after: SurfaceMap) -> None:
    off_mm = max(abs(before.x0_mm - after.x0_mm), abs(before.y0_mm - after.y0_mm))
    shapes = before.height_nm.shape, after.height_nm.shape
    if (
        shapes[0] != shapes[1]
        or abs(before.pixel_mm - after.pixel_mm) * max(shapes[0]) > _MAX_OFFSET_PIXELS * before.pixel_mm
        or off_mm > _MAX_OFFSET_PIXELS * before.pixel_mm
    ):
        raise InputError(
            f"footprint: the map before ({shapes[0][0]} x {shapes[0][1]} pixels of {before.pixel_mm:.6g} mm) and that "
            f"after ({shapes[1][0]} x {shapes[1][1]} of {after.pixel_mm:.6g} mm) are not of the same pixels",
            "measure both in the same place, or crop and register them",
        )


def _roughly(removed_nm: FloatArray, valid: NDArray[np.bool_]) -> tuple[float, float]:
    """Row and column of the highest place of the smoothed difference."""
    if not valid.any():
        raise InputError("footprint: the maps have no valid pixel in common", "check the masks of both")
    filled = np.where(valid, removed_nm - np.median(removed_nm[valid]), 0.0)
    smooth = ndimage.gaussian_filter(filled, max(1.0, 0.02 * min(filled.shape)))
    row, column = np.unravel_index(int(np.argmax(smooth)), smooth.shape)
    return float(row), float(column)


def _levelled(
    removed_nm: FloatArray, surroundings: NDArray[np.bool_], valid: NDArray[np.bool_]
) -> tuple[FloatArray, float]:
    """Return the difference without piston and tilt of the surroundings, and the noise there."""
    if surroundings.sum() < _MIN_SURROUNDINGS_SHARE * valid.sum():
        raise InputError(
            "footprint: fills the maps, so that nothing around it tells where zero is",
            "measure a larger field, or give --radius-mm",
        )
    rows, columns = np.nonzero(surroundings)
    terms = np.column_stack([np.ones(rows.size), rows, columns])
    plane, *_ = np.linalg.lstsq(terms, removed_nm[surroundings], rcond=None)
    row, column = np.indices(removed_nm.shape)
    levelled_nm = removed_nm - (plane[0] + plane[1] * row + plane[2] * column)
    return levelled_nm, float(levelled_nm[surroundings].std())


def _end(levelled_nm: FloatArray, valid: NDArray[np.bool_], distance: FloatArray, noise_nm: float) -> float:
    """Radius in pixels of the first ring, one pixel wide, that the footprint does not reach."""
    ring = np.rint(distance[valid]).astype(np.int64)
    pixels = np.bincount(ring)
    mean_nm = np.bincount(ring, levelled_nm[valid]) / np.maximum(pixels, 1)
    lost = (pixels > 0) & (
        mean_nm < np.maximum(_SIGNIFICANT * noise_nm / np.sqrt(np.maximum(pixels, 1)), _NEGLIGIBLE_SHARE * mean_nm[0])
    )
    lost[:2] = False
    return float(np.argmax(lost)) if lost.any() else float(ring.max())


def _centre(levelled_nm: FloatArray, inside: NDArray[np.bool_]) -> tuple[float, float]:
    """Centre of gravity of the upper half of the footprint, as row and column."""
    rows, columns = np.nonzero(inside)
    weight = levelled_nm[inside]
    weight = np.where(weight > 0.5 * weight.max(), weight, 0.0)
    return float(weight @ rows / weight.sum()), float(weight @ columns / weight.sum())


def _around(levelled_nm: FloatArray, row: float, column: float, radius: float) -> FloatArray:
    """Table with its middle on the centre, zero beyond the radius; cubic between the pixels."""
    half = int(np.ceil(radius))
    step = np.arange(-half, half + 1)
    places = np.meshgrid(row + step, column + step, indexing="ij")
    gaps = np.isnan(levelled_nm)
    sampled = ndimage.map_coordinates(np.where(gaps, 0.0, levelled_nm), places, order=3, mode="nearest")
    inside = np.hypot(step[:, None], step) <= radius
    missing = ndimage.map_coordinates(gaps.astype(float), places, order=1, mode="constant", cval=1.0) > 0
    if (missing & inside).any():
        raise InputError(
            "footprint: reaches pixels without data, or the edge of the maps", "measure it whole, or give --radius-mm"
        )
    return np.where(inside, sampled, 0.0)
