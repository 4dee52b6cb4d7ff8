"""What is to be removed, as the solver sees it: the clear aperture averaged over cells that the tool can resolve.

The influence function is smooth: inside a cell of a tenth of its width it removes nearly the same everywhere.
Comparing cell averages (of the target and, by the same average folded into the influence function, of the removal)
keeps all that the tool can correct and costs a small part of the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ibfctl.dwell.deposition import Grid
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.levelling import Levelling
from ibfctl.surface.map import SurfaceMap
from ibfctl.surface.terms import Removed

FloatArray = NDArray[np.float64]

# Cells per full width at half maximum of the influence function: to finish on, and to search on.
CELLS_PER_WIDTH = 10
COARSE_CELLS_PER_WIDTH = 4


@dataclass(frozen=True)
class Misfit:
    """Target removal on the cells of the clear aperture.

    Attributes
    ----------
    grid
        Grid of the cells.
    mask : (ny, nx) bool
        Cells that hold pixels of the clear aperture.
    root_weight : (m,) float64
        Square root of each cell's share of the clear aperture.
    target : (m,) float64
        Levelled target in nm times `root_weight`; its norm is an RMS in nm.
    levelling
        Free terms, over the weighted cells.
    influence
        Influence function averaged over a cell, on the pitch of the cells.
    """

    grid: Grid
    mask: NDArray[np.bool_]
    root_weight: FloatArray
    target: FloatArray
    levelling: Levelling
    influence: InfluenceFunction

    def of(self, removal_nm: FloatArray) -> FloatArray:
        """Levelled, weighted values (m,) of a removal (ny, nx); subtract from `target` for the residual."""
        return self.levelling(removal_nm.reshape(-1)[self._cells] * self.root_weight)

    def adjoint(self, values: FloatArray) -> FloatArray:
        """Adjoint of `of`: (ny, nx) from (m,)."""
        return self.spread(self.levelling(values))

    def spread(self, levelled: FloatArray) -> FloatArray:
        """The same for values (m,) that are levelled already, as a residual is."""
        result = np.zeros(self.mask.size)
        result[self._cells] = levelled * self.root_weight
        return result.reshape(self.mask.shape)

    @cached_property
    def _cells(self) -> slice | NDArray[np.int64]:
        """Where the cells of the mask lie in a flat array: quicker than the mask."""
        return slice(None) if self.mask.all() else np.flatnonzero(self.mask)


def full_width_mm(influence: InfluenceFunction) -> float:
    """Full width at half maximum of the narrower direction, of a Gaussian with the same second moments."""
    rate = np.clip(influence.rate_nm_s, 0.0, None)
    widths = []
    for axis in (0, 1):
        profile = rate.sum(axis=1 - axis)
        place = influence.pixel_mm * np.arange(profile.size)
        mean = np.average(place, weights=profile)
        widths.append(np.sqrt(np.average((place - mean) ** 2, weights=profile)))
    return float(np.sqrt(8 * np.log(2)) * min(widths))


def cell_size(surface: SurfaceMap, influence: InfluenceFunction, per_width: int = CELLS_PER_WIDTH) -> int:
    """Pixels per side of a cell."""
    return max(1, int(full_width_mm(influence) / (per_width * surface.pixel_mm)))


def make_misfit(
    surface: SurfaceMap,
    mask: NDArray[np.bool_],
    influence: InfluenceFunction,
    removed: Removed,
    cell: int,
    depth_nm: float | None = None,
) -> Misfit:
    """Average the clear aperture over cells of `cell` x `cell` pixels (1: keep the pixels).

    Parameters
    ----------
    surface
        The map; only pixels of `mask` (ny, nx) are read.
    influence
        Influence function, any pitch.
    removed
        Free terms.
    depth_nm
        What is to go everywhere beside the levelled height, with nothing free any more; None for none.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    row0, column0 = int(rows[0]), int(columns[0])
    ny, nx = (-(-(int(last[-1]) + 1 - int(last[0])) // cell) for last in (rows, columns))
    window = np.zeros((ny * cell, nx * cell))
    inside = np.zeros(window.shape, dtype=bool)
    part = (slice(row0, int(rows[-1]) + 1), slice(column0, int(columns[-1]) + 1))
    extent = (slice(0, part[0].stop - row0), slice(0, part[1].stop - column0))
    inside[extent] = mask[part]
    window[extent] = np.where(mask[part], surface.height_nm[part], 0.0)
    count = inside.reshape(ny, cell, nx, cell).sum(axis=(1, 3))
    total = window.reshape(ny, cell, nx, cell).sum(axis=(1, 3))
    cells = count > 0
    mean = total[cells] / count[cells]
    root_weight = np.sqrt(count[cells] / count.sum())
    levelling = Levelling.over(cells, removed, root_weight)
    target = levelling(mean * root_weight)
    if depth_nm is not None:
        target = target + depth_nm * root_weight
        levelling = Levelling.over(cells, "none")
    shift = 0.5 * (cell - 1) * surface.pixel_mm
    pitch = cell * surface.pixel_mm
    grid = Grid(
        ny,
        nx,
        pitch,
        surface.x0_mm + column0 * surface.pixel_mm + shift,
        surface.y0_mm + row0 * surface.pixel_mm + shift,
    )
    averaged = _averaged(influence.resampled(surface.pixel_mm), cell)
    return Misfit(grid, cells, root_weight, target, levelling, averaged)


def _averaged(influence: InfluenceFunction, cell: int) -> InfluenceFunction:
    """Average over squares of `cell` pixels around every `cell`-th pixel, the volume rate kept exactly."""
    if cell == 1:
        return influence
    # Half weights at the ends centre an even width on a pixel.
    window = np.ones(cell) if cell % 2 else np.concatenate([[0.5], np.ones(cell - 1), [0.5]])
    half_y, half_x = (-(-(size // 2 + cell) // cell) for size in influence.rate_nm_s.shape)
    size_y, size_x = influence.rate_nm_s.shape
    padded = np.pad(
        influence.rate_nm_s,
        ((half_y * cell - size_y // 2,) * 2, (half_x * cell - size_x // 2,) * 2),
    )
    for axis in (0, 1):
        padded = ndimage.convolve1d(padded, window / cell, axis=axis, mode="constant")
    sampled = InfluenceFunction(padded[::cell, ::cell], cell * influence.pixel_mm)
    scale = influence.volume_rate_nm_mm2_s / sampled.volume_rate_nm_mm2_s
    return InfluenceFunction(sampled.rate_nm_s * scale, sampled.pixel_mm)
