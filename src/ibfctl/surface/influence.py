"""What the tool removes per second."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ibfctl.errors import InputError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class InfluenceFunction:
    """Tool influence function (TIF): removal rate around the tool's centre.

    Attributes
    ----------
    rate_nm_s : (ny, nx) float64
        Removal rate, centred: the tool's centre is the centre of the table. Zero outside.
    pixel_mm : float
        Pixel pitch, the same along x and y.
    """

    rate_nm_s: FloatArray
    pixel_mm: float

    def __post_init__(self) -> None:
        if self.rate_nm_s.ndim != 2 or min(self.rate_nm_s.shape) < 3:
            raise InputError(
                f"influence function: must be a table of at least 3 x 3 pixels, not of shape {self.rate_nm_s.shape}",
                "give a two-dimensional table of removal rates",
            )
        if not (np.isfinite(self.pixel_mm) and self.pixel_mm > 0):
            raise InputError(
                f"influence function: pixel size is {self.pixel_mm:g} mm, it must be positive",
                "give the true pixel size in mm",
            )
        if not np.isfinite(self.rate_nm_s).all():
            raise InputError("influence function: holds NaN or infinite rates", "fill or crop them before planning")
        if not self.volume_rate_nm_mm2_s > 0:
            raise InputError(
                "influence function: removes nothing (its volume rate is not positive)",
                "rates must be positive where material goes away",
            )

    @property
    def volume_rate_nm_mm2_s(self) -> float:
        """Removed volume per second, in nm mm²/s."""
        return float(self.rate_nm_s.sum() * self.pixel_mm**2)

    @property
    def peak_rate_nm_s(self) -> float:
        """Peak removal rate."""
        return float(self.rate_nm_s.max())

    @property
    def radius_mm(self) -> float:
        """Half of the longer side of the table: beyond it nothing is removed."""
        return float(0.5 * (max(self.rate_nm_s.shape) - 1) * self.pixel_mm)

    def resampled(self, pixel_mm: float) -> InfluenceFunction:
        """Return the same function on another pixel pitch, with an odd number of pixels and the same volume rate.

        Cubic splines between the pixels; the volume rate is restored exactly, because it sets the scale of all
        dwell times.
        """
        ny, nx = self.rate_nm_s.shape
        half_x = int(np.ceil(0.5 * (nx - 1) * self.pixel_mm / pixel_mm - 1e-9))
        half_y = int(np.ceil(0.5 * (ny - 1) * self.pixel_mm / pixel_mm - 1e-9))
        if pixel_mm == self.pixel_mm and nx % 2 and ny % 2:
            return self
        scale = pixel_mm / self.pixel_mm
        rows = 0.5 * (ny - 1) + scale * np.arange(-half_y, half_y + 1)
        columns = 0.5 * (nx - 1) + scale * np.arange(-half_x, half_x + 1)
        rate = ndimage.map_coordinates(
            self.rate_nm_s, np.meshgrid(rows, columns, indexing="ij"), order=3, mode="constant", cval=0.0
        )
        resampled = InfluenceFunction(rate, pixel_mm)
        return InfluenceFunction(rate * (self.volume_rate_nm_mm2_s / resampled.volume_rate_nm_mm2_s), pixel_mm)

    def turned(self, matrix: FloatArray) -> InfluenceFunction:
        """Return the same function as seen in other directions.

        Parameters
        ----------
        matrix : (2, 2) float64
            Rotation or reflection, from directions in the result to directions in this function.
        """
        half_y, half_x = (0.5 * (size - 1) for size in self.rate_nm_s.shape)
        (xx, xy), (yx, yy) = matrix
        reach_x, reach_y = abs(xx) * half_x + abs(yx) * half_y, abs(xy) * half_x + abs(yy) * half_y
        if np.abs(matrix).max() == 1.0:  # right angles: pixel to pixel, an even number as well
            ny, nx = round(2 * reach_y) + 1, round(2 * reach_x) + 1
        else:
            ny, nx = 2 * int(np.ceil(reach_y)) + 1, 2 * int(np.ceil(reach_x)) + 1
        y, x = (np.arange(size) - 0.5 * (size - 1) for size in (ny, nx))
        places = np.stack(
            [yx * x + yy * y[:, None] + half_y, xx * x + xy * y[:, None] + half_x]  # rows, columns
        )
        rate = ndimage.map_coordinates(self.rate_nm_s, places, order=3, mode="constant", cval=0.0)
        # Splines ring where the rate ends at a step: beyond its pixels it is zero.
        support = ndimage.map_coordinates(
            (self.rate_nm_s != 0).astype(float), places, order=1, mode="constant", cval=0.0
        )
        rate = _trimmed(np.where(support > 0, rate, 0.0))
        turned = InfluenceFunction(rate, self.pixel_mm)
        return InfluenceFunction(rate * (self.volume_rate_nm_mm2_s / turned.volume_rate_nm_mm2_s), self.pixel_mm)


def _trimmed(rate: FloatArray) -> FloatArray:
    """Cut rows and columns of zeros at the rim, the centre kept."""
    cuts = []
    for axis in (1, 0):
        used = np.flatnonzero((rate != 0).any(axis=axis))
        size = rate.shape[1 - axis]
        cut = max(min(int(used[0]), size - 1 - int(used[-1])), 0) if used.size else 0
        cuts.append(slice(cut, size - cut))
    return rate[tuple(cuts)]


def gaussian(fwhm_mm: float, peak_nm_s: float, radius_mm: float, pixel_mm: float) -> InfluenceFunction:
    """Make a round Gaussian influence function, cut at `radius_mm`.

    Parameters
    ----------
    fwhm_mm, radius_mm
        Full width at half maximum, and the radius beyond which the rate is zero.
    peak_nm_s
        Peak removal rate.
    pixel_mm
        Pitch on which it is sampled.
    """
    for name, value in (
        ("fwhm_mm", fwhm_mm),
        ("peak_nm_s", peak_nm_s),
        ("radius_mm", radius_mm),
        ("pixel_mm", pixel_mm),
    ):
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"gaussian influence function: {name} is {value:g}, it must be positive", "correct it")
    half = int(np.ceil(radius_mm / pixel_mm - 1e-9))
    axis_mm = pixel_mm * np.arange(-half, half + 1)
    r2_mm2 = axis_mm[:, None] ** 2 + axis_mm[None, :] ** 2
    rate = peak_nm_s * np.exp(-4 * np.log(2) * r2_mm2 / fwhm_mm**2)
    return InfluenceFunction(np.where(r2_mm2 <= radius_mm**2 * (1 + 1e-12), rate, 0.0), pixel_mm)
