"""Levelling: what is free in what was measured is taken out, over the clear aperture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.surface.terms import Removed, terms_of

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Levelling:
    """Orthogonal projection that takes the free terms out of values on the clear aperture.

    Attributes
    ----------
    basis : (k, m) float64
        Orthonormal rows over the m pixels of the clear aperture.
    """

    basis: FloatArray

    @classmethod
    def over(cls, mask: NDArray[np.bool_], removed: Removed, root_weight: FloatArray | None = None) -> Levelling:
        """Make the projection for the pixels of `mask` (ny, nx).

        With `root_weight` (m,), values are expected multiplied by these square roots of weights.

        Raises
        ------
        InputError
            If `removed` names no terms.
        """
        rows, columns = np.nonzero(mask)
        terms = terms_of(removed, columns.astype(np.float64), rows.astype(np.float64))
        if root_weight is not None:
            terms = terms * root_weight
        if not terms.size:
            return cls(np.zeros((0, rows.size)))
        for _ in range(2):  # the second time takes away what rounding has left
            # A line of pixels has no tilt across it: drop what the others already span.
            left, size, _ = np.linalg.svd(terms @ terms.T)
            rank = int((size > 1e-12 * size[0]).sum())
            terms = (left[:, :rank] / np.sqrt(size[:rank])).T @ terms
        return cls(terms)

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return `values` (m,) without the free terms. The projection is its own adjoint."""
        if not self.basis.size:
            return values
        return values - (self.basis @ values) @ self.basis


def rms(values: FloatArray) -> float:
    """Root mean square of `values`."""
    return float(np.sqrt(np.mean(values**2)))


def peak_to_valley(values: FloatArray) -> float:
    """Largest minus smallest of `values`."""
    return float(np.ptp(values))
