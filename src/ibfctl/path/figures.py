"""Figures of a tool path: what it leaves uncovered, and what it asks of the machine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ibfctl.path.tool_path import ToolPath

FloatArray = NDArray[np.float64]

# Samples along the path per distance between pixels, and at most as many in all.
_SAMPLES_PER_PIXEL = 2
_MOST_SAMPLES = 2_000_000


@dataclass(frozen=True)
class PathFigures:
    """Figures of a path.

    Attributes
    ----------
    length_mm
        Way along all segments.
    shortest_step_mm
        Length of the shortest segment; zero where a node is repeated.
    sharpest_corner_deg
        Largest change of direction at a node: 0 straight on, 180 straight back.
    largest_gap_mm
        Largest distance of a pixel of the area to cover from the path; None where no area is known.
    """

    length_mm: float
    shortest_step_mm: float
    sharpest_corner_deg: float
    largest_gap_mm: float | None


def path_figures(path: ToolPath, pixels_mm: tuple[FloatArray, FloatArray] | None = None) -> PathFigures:
    """Measure a path.

    Parameters
    ----------
    path
        Nodes in mm.
    pixels_mm : pair of (m,) float64, optional
        x and y of the pixels that the path is to cover.
    """
    length_mm = path.length_mm
    return PathFigures(
        float(length_mm.sum()),
        float(length_mm.min()),
        _sharpest_corner_deg(path),
        None if pixels_mm is None else _largest_gap_mm(path, *pixels_mm),
    )


def _sharpest_corner_deg(path: ToolPath) -> float:
    moves = np.stack([np.diff(path.x_mm), np.diff(path.y_mm)])[:, path.length_mm > 0]
    along = (moves[:, 1:] * moves[:, :-1]).sum(axis=0)
    across = moves[0, :-1] * moves[1, 1:] - moves[1, :-1] * moves[0, 1:]
    return float(np.degrees(np.arctan2(np.abs(across), along)).max(initial=0.0))


def _largest_gap_mm(path: ToolPath, x_mm: FloatArray, y_mm: FloatArray) -> float:
    """Exact distances to the segment of the nearest sample, at most a small part of a pixel above the true ones."""
    length_mm = path.length_mm
    box_mm = np.hypot(np.ptp(x_mm), np.ptp(y_mm))
    spacing_mm = max(box_mm / np.sqrt(x_mm.size) / _SAMPLES_PER_PIXEL, length_mm.sum() / _MOST_SAMPLES, 1e-12)
    pieces = np.maximum(np.ceil(length_mm / spacing_mm), 1).astype(np.int64)
    segment = np.repeat(np.arange(length_mm.size), pieces)
    ordinal = np.arange(segment.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = (ordinal + 0.5) / pieces[segment]
    starts = np.column_stack([path.x_mm[:-1], path.y_mm[:-1]])
    moves = np.column_stack([np.diff(path.x_mm), np.diff(path.y_mm)])
    pixels = np.column_stack([x_mm, y_mm])
    _, nearest = cKDTree(starts[segment] + share[:, None] * moves[segment]).query(pixels, workers=2)
    chosen = segment[nearest]
    return float(distances_mm(pixels, starts[chosen], moves[chosen]).max())


def distances_mm(points: FloatArray, starts: FloatArray, moves: FloatArray) -> FloatArray:
    """Distance (n,) of each point (n, 2) from the straight line between `starts` (n, 2) and `starts + moves`."""
    square = (moves**2).sum(axis=1)
    along = ((points - starts) * moves).sum(axis=1)
    share = np.clip(np.divide(along, square, out=np.zeros_like(along), where=square > 0), 0.0, 1.0)
    return np.asarray(np.hypot(*(points - starts - share[:, None] * moves).T))
