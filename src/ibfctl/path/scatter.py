"""Scattered points whose distance follows a field: random, never much closer, and without holes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_CHUNK = 4096


@dataclass(frozen=True)
class Field:
    """Values on a regular lattice.

    Attributes
    ----------
    values : (ny, nx) float64
        NaN outside the region.
    lattice_mm, x0_mm, y0_mm
        Pitch of the lattice, and its place [0, 0].
    """

    values: FloatArray
    lattice_mm: float
    x0_mm: float
    y0_mm: float

    def at(self, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Values (n,) at the lattice places nearest to positions; NaN beyond the lattice."""
        row, column = (
            np.rint((place_mm - first_mm) / self.lattice_mm).astype(np.int64)
            for place_mm, first_mm in ((y_mm, self.y0_mm), (x_mm, self.x0_mm))
        )
        on_lattice = (row >= 0) & (row < self.values.shape[0]) & (column >= 0) & (column < self.values.shape[1])
        found = np.full(x_mm.shape, np.nan)
        found[on_lattice] = self.values[row[on_lattice], column[on_lattice]]
        return found


def scatter(distance_mm: Field, random: np.random.Generator) -> FloatArray:
    """Scatter points (n, 2) over a region, one after the other at random, until there is no room.

    A point keeps all later ones out of the disc of its local distance (random sequential adsorption), so that no place
    of the region is farther from a point than that point's distance; the lattice should be four times finer or more.
    """
    lattice = distance_mm.lattice_mm
    reach = np.nan_to_num(distance_mm.values / lattice)
    margin = int(reach.max()) + 1
    # Painted with room around, so that discs need no cutting.
    free = np.pad(np.isfinite(distance_mm.values), margin)
    offset = np.arange(-margin, margin + 1)
    from_middle = np.hypot(offset, offset[:, None])
    order = random.permutation(np.flatnonzero(free))
    width = free.shape[1]
    flat = free.reshape(-1)
    chosen: list[int] = []
    for first in range(0, order.size, _CHUNK):
        chunk = order[first : first + _CHUNK]
        for place in chunk[flat[chunk]].tolist():
            if not flat[place]:
                continue
            row, column = divmod(place, width)
            chosen.append(place)
            own = reach[row - margin, column - margin]
            half = int(own)
            inner = slice(margin - half, margin + half + 1)
            free[row - half : row + half + 1, column - half : column + half + 1] &= from_middle[inner, inner] > own
    places = np.column_stack(np.divmod(np.array(chosen, dtype=np.int64), width))[:, ::-1] - margin
    jitter = random.uniform(-0.5, 0.5, places.shape)
    return np.asarray([distance_mm.x0_mm, distance_mm.y0_mm] + lattice * (places + jitter))
