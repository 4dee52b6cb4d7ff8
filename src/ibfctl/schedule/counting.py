"""From mm and seconds to counts and samples, before the velocities are chosen.

Absolute positions and absolute times are rounded and their differences sent, so nothing accumulates. Rounding
comes first, so that the velocities are optimised for exactly the integers that the controller gets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import LimitsError
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import MAX_SEGMENT_SAMPLES, IntArray
from ibfctl.path.tool_path import ToolPath

FloatArray = NDArray[np.float64]

MAX_SEGMENTS = 2_000_000
# Halves go up, and so do what rounding has brought just below them.
_TIE = 0.5 + 1e-6


@dataclass(frozen=True)
class CountedPath:
    """A timed path on the controller's grid.

    Attributes
    ----------
    position_counts : mapping of axis letter to (n + 1,) int64
        Absolute positions of the nodes.
    time_samples : (n,) int64
        Even durations of the segments, at most 2048 samples.
    source_segment : (n,) int64
        Segment of the path that each belongs to: long dwells are split into several.
    """

    position_counts: Mapping[str, IntArray]
    time_samples: IntArray
    source_segment: IntArray

    def position_mm(self, letter: str, counts_per_mm: float) -> FloatArray:
        """Positions of the nodes of one axis in mm, (n + 1,)."""
        return np.asarray(self.position_counts[letter] / counts_per_mm)


def even_samples(time_s: FloatArray, sample_period_s: float) -> IntArray:
    """Round durations (n,) to even samples, zero allowed, so that the running sum never drifts by more than one sample.

    Halves always go up: a duration that is a whole number of sample pairs keeps them wherever it starts.
    """
    pairs = np.floor(np.cumsum(time_s) / (2 * sample_period_s) + _TIE).astype(np.int64)
    return np.asarray(2 * np.diff(pairs, prepend=0))


def count_path(path: ToolPath, samples: IntArray, machine: MachineDescription) -> CountedPath:
    """Put a timed path on the grid of counts; split segments longer than 2048 samples.

    Parameters
    ----------
    path
        Nodes in mm.
    samples : (n,) int64
        Even duration of each segment.
    machine
        Scales, directions and travel.

    Raises
    ------
    LimitsError
        If a node lies outside the travel of an axis, or the times make too many segments.
    """
    pieces = np.maximum(-(-samples // MAX_SEGMENT_SAMPLES), 1)
    if pieces.sum() > MAX_SEGMENTS:
        raise LimitsError(
            f"schedule: dwell times of up to {samples.max() * machine.sample_period_s:.3g} s make {pieces.sum()} "
            f"segments, more than {MAX_SEGMENTS}",
            "shorten the dwell times or split the job",
        )
    source = np.repeat(np.arange(samples.size), pieces)
    # Piece k of m ends at the even sample nearest to k/m of the segment: again absolute, never accumulated.
    ordinal = np.arange(source.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    parts, whole = pieces[source], samples[source]
    piece_end = np.where(ordinal + 1 == parts, whole, 2 * ((whole * (ordinal + 1)) // (2 * parts)))
    piece_start = 2 * ((whole * ordinal) // (2 * parts))
    reached = np.where(ordinal + 1 == parts, 1.0, piece_end / np.maximum(whole, 1))
    counts: dict[str, IntArray] = {}
    for letter, axis in machine.axes.items():
        node_mm = path.x_mm if axis.coordinate == "x" else path.y_mm
        outside = (node_mm < axis.travel_min_mm) | (node_mm > axis.travel_max_mm)
        if outside.any():
            node = int(np.argmax(outside))
            raise LimitsError(
                f"path leaves the travel of axis {letter}: node {node} at {axis.coordinate} = {node_mm[node]:.3f} mm, "
                f"travel {axis.travel_min_mm:g} to {axis.travel_max_mm:g} mm ({int(outside.sum())} nodes outside)",
                "move the part, shrink the clear aperture, or correct the travel in the machine file",
            )
        ends_mm = node_mm[source] + (node_mm[source + 1] - node_mm[source]) * reached
        scale = axis.signed_counts_per_mm
        counts[letter] = np.rint(np.concatenate([node_mm[:1], ends_mm]) * scale).astype(np.int64)
    return CountedPath(counts, piece_end - piece_start, source)
