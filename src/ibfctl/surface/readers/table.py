"""What every reader returns, and the placing of scattered coordinates on a uniform grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.surface.readers.quantity import MAX_PITCH_MISMATCH, MAX_PIXELS

FloatArray = NDArray[np.float64]

_MAX_OFF_GRID_PIXELS = 0.02
_MAX_COLUMNS = 32768


@dataclass(frozen=True)
class Table:
    """The content of one file.

    Attributes
    ----------
    values : (ny, nx) float64
        In nm or nm/s; NaN where the file holds no data.
    pixel_mm : float
        Pixel pitch.
    x0_mm, y0_mm : float or None
        Centre of pixel [0, 0]; None where the file has no coordinates and the table is centred.
    """

    values: FloatArray
    pixel_mm: float
    x0_mm: float | None = None
    y0_mm: float | None = None


@dataclass(frozen=True)
class Axis:
    """A uniform axis: its first coordinate, its pitch, and the index of every point on it."""

    start: float
    pitch: float
    index: NDArray[np.int64]

    @property
    def size(self) -> int:
        """Number of grid lines."""
        return int(self.index.max()) + 1


def uniform_axis(coordinate: FloatArray, name: str, where: str) -> Axis:
    """Find the uniform grid on which the coordinates (n,) lie, whichever of its points are absent."""
    if not np.isfinite(coordinate).all():
        raise InputError(f"{where}: {name} holds coordinates that are no numbers", "drop those rows")
    lines = np.unique(coordinate)
    span = lines[-1] - lines[0]
    gaps = np.diff(lines)
    gaps = gaps[gaps > span / _MAX_COLUMNS]
    if gaps.size == 0:
        raise InputError(f"{where}: all points have the same {name}", "give a two-dimensional grid of points")
    pitch = span / max(1, round(span / float(np.median(gaps))))
    place = (coordinate - lines[0]) / pitch
    index = np.rint(place)
    off = float(np.abs(place - index).max())
    if off > _MAX_OFF_GRID_PIXELS:
        raise InputError(
            f"{where}: {name} is not on a uniform grid (a point is {off:.2g} of its pitch {pitch:.6g} off)",
            "interpolate the points to a uniform grid first",
        )
    return Axis(float(lines[0]), float(pitch), index.astype(np.int64))


def square_pitch(x: float, y: float, where: str) -> float:
    """Return the common pitch of both axes."""
    if abs(x - y) > MAX_PITCH_MISMATCH * x:
        raise InputError(
            f"{where}: pixels are not square (pitch {x:.6g} along x, {y:.6g} along y)",
            "check that x and y are in the same unit, or resample to square pixels",
        )
    return 0.5 * (x + y)


def check_size(shape: tuple[int, ...], where: str) -> None:
    """Refuse what cannot be a map before anything of its size is allocated."""
    if len(shape) != 2:
        raise InputError(
            f"{where}: must be a table of two dimensions, not of {len(shape)}", "give a two-dimensional table"
        )
    if shape[0] * shape[1] > MAX_PIXELS:
        raise InputError(
            f"{where}: declares {shape[0]} x {shape[1]} pixels, more than the {MAX_PIXELS} that are allowed",
            "crop or bin the map",
        )
