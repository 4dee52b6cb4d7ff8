"""Surface extension: what a tool that overruns the clear aperture is to find beyond its edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ibfctl.dwell.deposition import Grid
from ibfctl.dwell.misfit import Misfit

FloatArray = NDArray[np.float64]


def extended(misfit: Misfit, grid: Grid) -> FloatArray:
    """Target (ny, nx) in nm on a grid in line with the cells, each cell beyond them as the nearest of them."""
    row = round((misfit.grid.y0_mm - grid.y0_mm) / grid.pixel_mm)
    column = round((misfit.grid.x0_mm - grid.x0_mm) / grid.pixel_mm)
    rows, columns = np.nonzero(misfit.mask)
    known, values = np.zeros((grid.ny, grid.nx), dtype=bool), np.zeros((grid.ny, grid.nx))
    inside = _within(rows + row, grid.ny) & _within(columns + column, grid.nx)
    place = rows[inside] + row, columns[inside] + column
    known[place] = True
    values[place] = (misfit.target / misfit.root_weight)[inside]
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)])


def _within(index: NDArray[np.int64], size: int) -> NDArray[np.bool_]:
    return np.asarray((index >= 0) & (index < size))
