"""A tool path: nodes in order. Between two nodes lies a segment, and in its middle a dwell point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ToolPath:
    """Nodes of a path on the part.

    Attributes
    ----------
    x_mm, y_mm : (n + 1,) float64
        Nodes in the order in which the tool visits them; n segments.
    """

    x_mm: FloatArray
    y_mm: FloatArray

    def __post_init__(self) -> None:
        if self.x_mm.ndim != 1 or self.x_mm.shape != self.y_mm.shape or self.x_mm.size < 2:
            raise InputError("path: needs at least two nodes with x and y each", "give more nodes")
        bad = ~(np.isfinite(self.x_mm) & np.isfinite(self.y_mm))
        if bad.any():
            raise InputError(f"path: node {int(np.argmax(bad))} is not a finite position", "correct that row")

    @property
    def segments(self) -> int:
        """Number of segments, n."""
        return self.x_mm.size - 1

    @property
    def dwell_x_mm(self) -> FloatArray:
        """Dwell points along x, (n,)."""
        return 0.5 * (self.x_mm[1:] + self.x_mm[:-1])

    @property
    def dwell_y_mm(self) -> FloatArray:
        """Dwell points along y, (n,)."""
        return 0.5 * (self.y_mm[1:] + self.y_mm[:-1])

    @property
    def length_mm(self) -> FloatArray:
        """Length of every segment, (n,)."""
        return np.hypot(np.diff(self.x_mm), np.diff(self.y_mm))

    @property
    def straight(self) -> NDArray[np.bool_]:
        """Whether each segment goes straight on into the next, (n - 1,)."""
        move = np.stack([np.diff(self.x_mm), np.diff(self.y_mm)])
        along = (move[:, 1:] * move[:, :-1]).sum(axis=0)
        across = move[0, :-1] * move[1, 1:] - move[1, :-1] * move[0, 1:]
        return np.asarray((along > 0) & (np.abs(across) <= 1e-6 * along))
