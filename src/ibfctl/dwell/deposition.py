"""Where time lands: a sparse matrix that spreads seconds, spent anywhere, over the pixels of a grid.

A second spent between pixels is spread over the 4 x 4 pixels around it with the weights of cubic
Lagrange interpolation. The removal that follows by convolution with the influence function is then
exactly what direct summation gives with the influence function interpolated by the same cubic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]

_TAPS = np.arange(-1, 3)


@dataclass(frozen=True)
class Grid:
    """A regular grid of pixels.

    Attributes
    ----------
    ny, nx
        Number of rows and columns.
    pixel_mm, x0_mm, y0_mm
        Pitch, and centre of pixel [0, 0].
    """

    ny: int
    nx: int
    pixel_mm: float
    x0_mm: float
    y0_mm: float


def grid_of(surface: SurfaceMap) -> Grid:
    """Return the pixels of a map."""
    ny, nx = surface.height_nm.shape
    return Grid(ny, nx, surface.pixel_mm, surface.x0_mm, surface.y0_mm)


def cubic_weights(fraction: FloatArray) -> FloatArray:
    """Cubic Lagrange weights of the pixels at -1, 0, 1, 2 for positions `fraction` (n,) in [0, 1).

    Returns
    -------
    (n, 4) float64
        Rows sum to one.
    """
    f = fraction
    return np.stack(
        [
            -f * (f - 1) * (f - 2) / 6,
            (f + 1) * (f - 1) * (f - 2) / 2,
            -(f + 1) * f * (f - 2) / 2,
            (f + 1) * f * (f - 1) / 6,
        ],
        axis=-1,
    )


def grid_around(grid: Grid, x_mm: FloatArray, y_mm: FloatArray) -> Grid:
    """Return the grid in line with `grid` that holds all positions and their 4 x 4 neighbourhoods.

    One pixel more on every side: a position on a pixel's centre may fall to either neighbour by rounding.
    """
    column0 = int(np.floor((x_mm.min() - grid.x0_mm) / grid.pixel_mm)) - 2
    row0 = int(np.floor((y_mm.min() - grid.y0_mm) / grid.pixel_mm)) - 2
    column1 = int(np.floor((x_mm.max() - grid.x0_mm) / grid.pixel_mm)) + 3
    row1 = int(np.floor((y_mm.max() - grid.y0_mm) / grid.pixel_mm)) + 3
    return Grid(
        row1 - row0 + 1,
        column1 - column0 + 1,
        grid.pixel_mm,
        grid.x0_mm + column0 * grid.pixel_mm,
        grid.y0_mm + row0 * grid.pixel_mm,
    )


def spread(grid: Grid, x_mm: FloatArray, y_mm: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Pixels and weights over which a second at each position is spread.

    Parameters
    ----------
    x_mm, y_mm : (n,) float64
        Positions, inside `grid_around(...)`.

    Returns
    -------
    indices, weights : (n, 16)
        Flat pixel indices and weights.
    """
    column = (x_mm - grid.x0_mm) / grid.pixel_mm
    row = (y_mm - grid.y0_mm) / grid.pixel_mm
    column_floor, row_floor = np.floor(column), np.floor(row)
    weight_x = cubic_weights(column - column_floor)
    weight_y = cubic_weights(row - row_floor)
    columns = column_floor.astype(np.int64)[:, None] + _TAPS
    rows = row_floor.astype(np.int64)[:, None] + _TAPS
    indices = (rows[:, :, None] * grid.nx + columns[:, None, :]).reshape(-1, 16)
    return indices, (weight_y[:, :, None] * weight_x[:, None, :]).reshape(-1, 16)


def deposition_matrix(
    grid: Grid, x_mm: FloatArray, y_mm: FloatArray, share: FloatArray, first_point: NDArray[np.int64]
) -> sparse.csr_array:
    """Sparse matrix from the seconds of n steps to seconds on the pixels.

    Parameters
    ----------
    x_mm, y_mm, share : (p,) float64
        Points in the order of the steps, and the share of its step's time that is spent at each.
    first_point : (n + 1,) int64
        Step i owns the points from `first_point[i]` up to `first_point[i + 1]`.

    Returns
    -------
    (n, pixels) csr_array
        One row per step: its transpose deposits, itself gathers.
    """
    indices, weights = spread(grid, x_mm, y_mm)
    weights *= share[:, None]
    matrix = sparse.csr_array(
        (weights.ravel(), indices.ravel(), 16 * first_point), shape=(first_point.size - 1, grid.ny * grid.nx)
    )
    if x_mm.size > first_point.size - 1:
        matrix.sum_duplicates()
    return matrix
