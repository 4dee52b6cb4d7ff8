"""A measured surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Rectangle:
    """A rectangle on the part, in mm."""

    x0_mm: float
    x1_mm: float
    y0_mm: float
    y1_mm: float


@dataclass(frozen=True)
class SurfaceMap:
    """Height over the part; positive where material must go.

    Attributes
    ----------
    height_nm : (ny, nx) float64
        NaN where nothing was measured. y grows with the row index, x with the column.
    pixel_mm : float
        Pixel pitch, the same along x and y.
    x0_mm, y0_mm : float
        Centre of pixel [0, 0] on the part.
    """

    height_nm: FloatArray
    pixel_mm: float
    x0_mm: float
    y0_mm: float

    def __post_init__(self) -> None:
        if self.height_nm.ndim != 2 or min(self.height_nm.shape) < 2:
            raise InputError(
                f"map: height must be a table of at least 2 x 2 pixels, not of shape {self.height_nm.shape}",
                "give a two-dimensional map",
            )
        if not (np.isfinite(self.pixel_mm) and self.pixel_mm > 0):
            raise InputError(
                f"map: pixel size is {self.pixel_mm:g} mm, it must be positive", "give the true pixel size in mm"
            )
        if np.isinf(self.height_nm).any():
            raise InputError("map: holds infinite heights", "mark pixels without data as NaN")
        if not np.isfinite(self.height_nm).any():
            raise InputError("map: holds no valid pixel", "check the file and its units")

    @classmethod
    def centred(cls, height_nm: FloatArray, pixel_mm: float) -> SurfaceMap:
        """Make a map whose centre lies at the origin of the part."""
        ny, nx = height_nm.shape
        return cls(height_nm, pixel_mm, -0.5 * (nx - 1) * pixel_mm, -0.5 * (ny - 1) * pixel_mm)

    @property
    def x_mm(self) -> FloatArray:
        """Pixel centres along x, shape (nx,)."""
        return np.asarray(self.x0_mm + self.pixel_mm * np.arange(self.height_nm.shape[1]), dtype=np.float64)

    @property
    def y_mm(self) -> FloatArray:
        """Pixel centres along y, shape (ny,)."""
        return np.asarray(self.y0_mm + self.pixel_mm * np.arange(self.height_nm.shape[0]), dtype=np.float64)

    @property
    def extent_mm(self) -> Rectangle:
        """Outer edges of the pixels."""
        half = 0.5 * self.pixel_mm
        x, y = self.x_mm, self.y_mm
        return Rectangle(x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
