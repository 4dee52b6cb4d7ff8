"""What is to go from the clear aperture, and what a removal leaves of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ibfctl.dwell.misfit import COARSE_CELLS_PER_WIDTH, cell_size
from ibfctl.errors import InputError
from ibfctl.planning.options import PlanOptions
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.levelling import Levelling
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Target:
    """Target removal over the clear aperture.

    Attributes
    ----------
    clear_aperture : (ny, nx) bool
        Pixels that count.
    levelling
        Takes out of a removal what is free.
    height_nm : (m,) float64
        Levelled height of the pixels of the clear aperture.
    depth_nm
        What is to go everywhere beside that height; None where the terms of the options are free.
    """

    clear_aperture: NDArray[np.bool_]
    levelling: Levelling
    height_nm: FloatArray
    depth_nm: float | None

    @classmethod
    def of(
        cls, surface: SurfaceMap, influence: InfluenceFunction, mask: NDArray[np.bool_], options: PlanOptions
    ) -> Target:
        """Target of a map over the pixels of `mask` (ny, nx).

        With an extra removal, every place loses at least that depth: the lowest one just so, of averages over a
        quarter of the tool's width, because single pixels are noise. The options' terms are then taken out of the map
        but are not free in the removal. Where they are none, the depth comes on top of the map's own heights.

        Raises
        ------
        InputError
            If the extra removal is no positive depth, or the options name no terms.
        """
        free = Levelling.over(mask, options.remove)
        height_nm = free(surface.height_nm[mask])
        extra_nm = options.extra_removal_nm
        if extra_nm is None:
            return cls(mask, free, height_nm, None)
        if not (np.isfinite(extra_nm) and extra_nm > 0):
            raise InputError(f"extra removal is {extra_nm:g} nm, it must be positive", "correct --extra-removal-nm")
        if free.basis.size:
            extra_nm -= _lowest(height_nm, mask, cell_size(surface, influence, COARSE_CELLS_PER_WIDTH))
        return cls(mask, Levelling.over(mask, "none"), height_nm, extra_nm)

    @property
    def wanted_nm(self) -> FloatArray:
        """What is to go from each pixel of the clear aperture, (m,)."""
        return self.height_nm if self.depth_nm is None else self.height_nm + self.depth_nm

    def residual_nm(self, removal_nm: FloatArray) -> FloatArray:
        """Levelled residual (m,) of the clear aperture after a removal (ny, nx)."""
        return np.asarray(self.wanted_nm - self.levelling(removal_nm[self.clear_aperture]))

    def residual_map_nm(self, removal_nm: FloatArray) -> FloatArray:
        """Levelled residual (ny, nx) after a removal (ny, nx), NaN outside the clear aperture."""
        return self._spread(self.residual_nm(removal_nm))

    def height_map_nm(self) -> FloatArray:
        """Levelled height (ny, nx), NaN outside the clear aperture."""
        return self._spread(self.height_nm)

    def _spread(self, values: FloatArray) -> FloatArray:
        result = np.full(self.clear_aperture.shape, np.nan)
        result[self.clear_aperture] = values
        return result


def _lowest(height_nm: FloatArray, mask: NDArray[np.bool_], cell: int) -> float:
    """Lowest of the averages around the pixels of `mask`, in windows of `cell` pixels."""
    spread = np.zeros(mask.shape)
    spread[mask] = height_nm
    total, share = (ndimage.uniform_filter(values, cell, mode="constant") for values in (spread, mask.astype(float)))
    return float((total[mask] / share[mask]).min())
