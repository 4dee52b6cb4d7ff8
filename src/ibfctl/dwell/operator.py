"""The removal operator: from seconds of every step to nanometres on the map, and its exact adjoint.

Time is deposited on a grid in line with the map and convolved with the influence function by one real
transform each way: N log N in the pixels, never a stamp per path point.
"""

from __future__ import annotations

import copy
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import fft, sparse

from ibfctl.dwell.deposition import Grid, deposition_matrix, grid_around, spread
from ibfctl.surface.influence import InfluenceFunction

FloatArray = NDArray[np.float64]
Precision = type[np.float64] | type[np.float32]

# Below this size a second thread costs more than it saves.
_THREADED_PIXELS = 1 << 17


class Convolution:
    """Removal on a map's pixels from seconds deposited on a second grid in line with it.

    Parameters
    ----------
    target
        Grid of the map.
    source
        Grid on which time is deposited; same pitch and phase as `target`.
    influence
        Influence function; resampled to the pitch of the grids.
    precision
        Of the transforms: single where a descent only needs a direction.
    """

    def __init__(
        self, target: Grid, source: Grid, influence: InfluenceFunction, precision: Precision = np.float64
    ) -> None:
        kernel = influence.resampled(target.pixel_mm).rate_nm_s
        half = kernel.shape[0] // 2, kernel.shape[1] // 2
        offset = (
            round((target.y0_mm - source.y0_mm) / target.pixel_mm),
            round((target.x0_mm - source.x0_mm) / target.pixel_mm),
        )
        self._target_shape = (target.ny, target.nx)
        self._source_shape = (source.ny, source.nx)
        self._shape = (
            _length(offset[0], target.ny, source.ny, half[0]),
            _length(offset[1], target.nx, source.nx, half[1]),
        )
        self._workers = 2 if self._shape[0] * self._shape[1] > _THREADED_PIXELS else 1
        # The offset between the grids goes into the kernel: both keep their first pixel at index zero.
        padded = np.zeros(self._shape)
        rows, columns = (
            (np.arange(-reach, reach + 1) - shift) % length
            for reach, shift, length in zip(half, offset, self._shape, strict=True)
        )
        padded[np.ix_(rows, columns)] = kernel
        self.precision = precision
        self._transfer = fft.rfft2(padded.astype(precision), workers=self._workers)
        self._reverse = np.conj(self._transfer)

    def __call__(self, time_s: FloatArray) -> FloatArray:
        """Removal (ny, nx) in nm from seconds on the source grid."""
        return self._filtered(time_s, self._transfer)[: self._target_shape[0], : self._target_shape[1]]

    def adjoint(self, values: FloatArray) -> FloatArray:
        """Adjoint of the call: from values on the map (ny, nx) to the source grid."""
        return self._filtered(values, self._reverse)[: self._source_shape[0], : self._source_shape[1]]

    def _filtered(self, values: FloatArray, transfer: NDArray[np.complex128]) -> FloatArray:
        spectrum = fft.rfft2(values.astype(self.precision, copy=False), self._shape, workers=self._workers)
        spectrum *= transfer
        return np.asarray(fft.irfft2(spectrum, self._shape, workers=self._workers, overwrite_x=True))


def _length(offset: int, target: int, source: int, half: int) -> int:
    """Shortest fast transform length without wrap-around between source and target pixels."""
    reach = max(offset + target - 1, source - 1 - offset)
    return int(fft.next_fast_len(max(reach + half + 1, source, target), real=True))


class Removal(Protocol):
    """Linear map from the seconds spent on n steps, of one tool or of several, to the removal on a map."""

    @property
    def steps(self) -> int:
        """Number of steps, n."""

    def __call__(self, time_s: FloatArray) -> FloatArray:
        """Removal (ny, nx) in nm for `time_s` (n,)."""

    def adjoint(self, values: FloatArray) -> FloatArray:
        """Adjoint of the call: (n,) from values (ny, nx) on the map."""


class RemovalOperator:
    """Linear map from the seconds spent on n steps to the removal on a map.

    Parameters
    ----------
    target
        Grid of the map.
    influence
        Tool influence function.
    x_mm, y_mm : (p,) float64
        Where time is spent, in the order of the steps: one dwell point each, or points along their motion.
    share : (p,) float64, optional
        Share of its step's time that is spent at each point; all of it by default.
    first_point : (n + 1,) int64, optional
        Step i owns the points from `first_point[i]` up to `first_point[i + 1]`; one each by default.
    precision
        Of the transforms, see `Convolution`.
    """

    def __init__(
        self,
        target: Grid,
        influence: InfluenceFunction,
        x_mm: FloatArray,
        y_mm: FloatArray,
        share: FloatArray | None = None,
        first_point: NDArray[np.int64] | None = None,
        precision: Precision = np.float64,
    ) -> None:
        if share is None:
            share = np.ones(x_mm.size)
        if first_point is None:
            first_point = np.arange(x_mm.size + 1)
        self.source = grid_around(target, x_mm, y_mm)
        self.convolution = Convolution(target, self.source, influence, precision)
        self.gather = deposition_matrix(self.source, x_mm, y_mm, share, first_point)

    @property
    def steps(self) -> int:
        """Number of steps, n."""
        return int(self.gather.shape[0])

    def on(self, target: Grid, influence: InfluenceFunction) -> RemovalOperator:
        """Return the operator of the same steps on another grid in line with this one."""
        other = copy.copy(self)
        other.convolution = Convolution(target, self.source, influence, self.convolution.precision)
        return other

    @cached_property
    def _deposit(self) -> sparse.csr_array:
        return self.gather.T.tocsr()

    def __call__(self, time_s: FloatArray) -> FloatArray:
        """Removal (ny, nx) in nm for `time_s` (n,)."""
        return self.convolution((self._deposit @ time_s).reshape(self.source.ny, self.source.nx))

    def adjoint(self, values: FloatArray) -> FloatArray:
        """Adjoint of the call: (n,) from values (ny, nx) on the map."""
        return np.asarray(self.gather @ self.convolution.adjoint(values).ravel())


def removal_of_samples(
    target: Grid, influence: InfluenceFunction, x_mm: FloatArray, y_mm: FloatArray, time_s: FloatArray
) -> FloatArray:
    """Removal (ny, nx) in nm of a tool that spent `time_s` (n,) at positions (n,), without building a matrix."""
    source = grid_around(target, x_mm, y_mm)
    deposited = np.zeros(source.ny * source.nx)
    chunk = 1 << 17
    for first in range(0, x_mm.size, chunk):
        part = slice(first, first + chunk)
        indices, weights = spread(source, x_mm[part], y_mm[part])
        weights *= np.broadcast_to(time_s, x_mm.shape)[part, None]
        deposited += np.bincount(indices.ravel(), weights.ravel(), minlength=deposited.size)
    return Convolution(target, source, influence)(deposited.reshape(source.ny, source.nx))
