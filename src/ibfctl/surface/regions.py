"""Regions of a part: rectangle, circle, polygon, or a mask on the pixels of its map."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.surface.map import Rectangle, SurfaceMap

# Pixels that lie on an edge but for rounding belong to the region.
_SLACK_PIXELS = 1e-9


@dataclass(frozen=True)
class Circle:
    """A circle on the part, in mm."""

    x_mm: float
    y_mm: float
    radius_mm: float


@dataclass(frozen=True)
class Polygon:
    """A polygon on the part: corners (x, y) in mm, in order; the last is joined to the first."""

    points_mm: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class MaskFile:
    """A file with one value per pixel of the map, zero outside the region: `.npy`, or `.npz` with an array `mask`."""

    path: Path


Region = Rectangle | Circle | Polygon | MaskFile


def pixels_in(region: Region, surface: SurfaceMap) -> NDArray[np.bool_]:
    """Pixels (ny, nx) of the map whose centres lie in the region or on its edge.

    Raises
    ------
    InputError
        If the region is none, or a mask cannot be read or does not fit the map.
    """
    slack_mm = _SLACK_PIXELS * surface.pixel_mm
    x_mm, y_mm = surface.x_mm, surface.y_mm[:, None]
    match region:
        case Rectangle(x0_mm, x1_mm, y0_mm, y1_mm):
            if not (np.isfinite([x0_mm, x1_mm, y0_mm, y1_mm]).all() and x0_mm < x1_mm and y0_mm < y1_mm):
                raise InputError(
                    f"clear aperture: x {x0_mm:g} to {x1_mm:g}, y {y0_mm:g} to {y1_mm:g} mm is empty",
                    "give --clear-aperture X0,X1,Y0,Y1 with X0 < X1 and Y0 < Y1",
                )
            inside_x = (x_mm >= x0_mm - slack_mm) & (x_mm <= x1_mm + slack_mm)
            return np.asarray(inside_x & (y_mm >= y0_mm - slack_mm) & (y_mm <= y1_mm + slack_mm))
        case Circle(middle_x_mm, middle_y_mm, radius_mm):
            if not (np.isfinite([middle_x_mm, middle_y_mm, radius_mm]).all() and radius_mm > 0):
                raise InputError(
                    f"clear aperture: a circle of radius {radius_mm:g} mm is empty",
                    "give --clear-aperture circle:X,Y,R with R > 0",
                )
            return np.asarray(np.hypot(x_mm - middle_x_mm, y_mm - middle_y_mm) <= radius_mm + slack_mm)
        case Polygon(points_mm):
            return _in_polygon(np.array(points_mm, dtype=np.float64).reshape(-1, 2), surface, slack_mm)
        case MaskFile(path):
            return _read_mask(path, surface.height_nm.shape)


def _in_polygon(points_mm: NDArray[np.float64], surface: SurfaceMap, slack_mm: float) -> NDArray[np.bool_]:
    """Even-odd rule along every row, one edge after the other, and the edges themselves."""
    if points_mm.shape[0] < 3 or not np.isfinite(points_mm).all():
        raise InputError(
            f"clear aperture: a polygon of {points_mm.shape[0]} points is none",
            "give --clear-aperture polygon:FILE, or polygon:X,Y,X,Y,X,Y with at least three finite points",
        )
    x_mm, y_mm = surface.x_mm, surface.y_mm
    inside, on_edge = (np.zeros(surface.height_nm.shape, dtype=bool) for _ in range(2))
    for (x0_mm, y0_mm), (x1_mm, y1_mm) in zip(points_mm, np.roll(points_mm, -1, axis=0), strict=True):
        low_mm, high_mm = min(y0_mm, y1_mm), max(y0_mm, y1_mm)
        touched = slice(*np.searchsorted(y_mm, [low_mm - slack_mm, high_mm + slack_mm]))
        if y0_mm == y1_mm:
            between = (x_mm >= min(x0_mm, x1_mm) - slack_mm) & (x_mm <= max(x0_mm, x1_mm) + slack_mm)
            on_edge[touched] |= between
            continue
        share = np.clip((y_mm[:, None] - y0_mm) / (y1_mm - y0_mm), 0.0, 1.0)
        edge_mm = x0_mm + (x1_mm - x0_mm) * share
        on_edge[touched] |= np.abs(x_mm - edge_mm[touched]) <= slack_mm
        crossed = slice(*np.searchsorted(y_mm, [low_mm, high_mm]))
        inside[crossed] ^= x_mm > edge_mm[crossed]
    return inside | on_edge


def _read_mask(path: Path, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    try:
        if path.suffix.lower() == ".npz":
            with zipfile.ZipFile(path) as archive, archive.open("mask.npy") as stream:
                return _mask_of(stream, path, shape)
        with path.open("rb") as stream:
            return _mask_of(stream, path, shape)
    except InputError:
        raise
    except Exception as error:  # a damaged archive makes zipfile, zlib and numpy raise almost anything
        raise InputError(
            f"mask {path}: cannot be read ({error})", "give a .npy file, or a .npz file with an array `mask`"
        ) from error


def _mask_of(stream: IO[bytes], path: Path, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Read an array whose shape is known before anything is allocated for it."""
    version = npy.read_magic(stream)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    held, _, dtype = read(stream)
    if held != shape:
        raise InputError(
            f"mask {path}: is of shape {held}, the map of shape {shape}", "a mask has one value per pixel of the map"
        )
    if dtype.kind not in "biuf":
        raise InputError(f"mask {path}: holds {dtype}, no numbers", "store zero outside the region, one inside")
    stream.seek(0)
    return np.asarray(np.nan_to_num(npy.read_array(stream, allow_pickle=False)) != 0)
