"""Power spectral densities of a map: along x, along y, and averaged over directions.

The mean square of the map is the sum of density times weight: one-sided along an axis in nm² mm against 1/mm, over
both axes in nm² mm². Pixels without data count as zero height; the densities are those of the pixels with data. No
window is laid over the map: what does not end as it begins leaks as 1/f².
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import fft

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Spectrum:
    """A power spectral density.

    Attributes
    ----------
    frequency_per_mm : (k,) float64
        Spatial frequencies, ascending from zero.
    density : (k,) float64
        In nm² mm along an axis, in nm² mm² over directions.
    weight : (k,) float64
        Width of each frequency in 1/mm, or area of its ring in 1/mm².
    """

    frequency_per_mm: FloatArray
    density: FloatArray
    weight: FloatArray


def psd_along(height_nm: FloatArray, pixel_mm: float, coordinate: Literal["x", "y"]) -> Spectrum:
    """Density along x or y, the mean over all lines of a map (ny, nx), NaN where it holds no data."""
    lines, valid = _filled(height_nm if coordinate == "x" else height_nm.T)
    count = lines.shape[1]
    power = (np.abs(fft.rfft(lines, axis=1)) ** 2).sum(axis=0) * _sides(count)
    frequency = fft.rfftfreq(count, pixel_mm)
    return Spectrum(frequency, power * pixel_mm / valid, np.full(frequency.size, 1 / (count * pixel_mm)))


def psd_radial(height_nm: FloatArray, pixel_mm: float) -> Spectrum:
    """Density over both axes of a map (ny, nx), NaN where it holds no data, averaged in rings up to the corners.

    Rings are as fine as the longer side resolves up to the first wave over the shorter one, then as fine as the shorter
    side: finer ones would hold its harmonics or miss them, in turn.
    """
    filled, valid = _filled(height_nm)
    ny, nx = filled.shape
    density = np.abs(fft.rfft2(filled)) ** 2 * pixel_mm**2 / valid
    area = np.broadcast_to(_sides(nx) / (nx * ny * pixel_mm**2), density.shape)
    frequency = np.hypot(fft.rfftfreq(nx, pixel_mm), fft.fftfreq(ny, pixel_mm)[:, None])
    long, short = max(nx, ny), min(nx, ny)
    fine, coarse = (np.rint(frequency * side * pixel_mm).astype(np.int64) for side in (long, short))
    ring = np.where(coarse < 1, fine, long + coarse).ravel()
    weight, power, place = (
        np.bincount(ring, (values * area).ravel()).astype(np.float64)
        for values in (np.ones_like(density), density, frequency)
    )
    used = weight > 0
    return Spectrum(place[used] / weight[used], power[used] / weight[used], weight[used])


def _filled(height_nm: FloatArray) -> tuple[FloatArray, int]:
    """Heights on the box around the pixels with data, zero where there are none, and how many have data."""
    valid = np.isfinite(height_nm)
    rows, columns = np.flatnonzero(valid.any(axis=1)), np.flatnonzero(valid.any(axis=0))
    box = np.ix_(range(rows[0], rows[-1] + 1), range(columns[0], columns[-1] + 1))
    return np.where(valid[box], height_nm[box], 0.0), int(valid.sum())


def _sides(count: int) -> FloatArray:
    """How often each frequency of a real transform of `count` values stands for: with its negative, or alone."""
    sides = np.full(count // 2 + 1, 2.0)
    sides[0] = 1.0
    if count % 2 == 0:
        sides[-1] = 1.0
    return sides
