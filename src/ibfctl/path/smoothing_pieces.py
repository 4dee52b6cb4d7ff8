"""A smoothed path in pieces between nodes: what a scheduler of cubics can walk.

Every programmed segment is walked from the middle of the block at its first corner over its straight leg to the
middle of the block at its second, and all of its pieces belong to it. A cubic that is monotone in both axes between
these nodes and stays near their chord stays within the tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.path.smoothing import TANGENT_WEIGHT, SmoothedCorners, smooth_corners
from ibfctl.path.tool_path import ToolPath

FloatArray = NDArray[np.float64]

# Part of the tolerance that is left to the motion around the chords of half blocks: blocks of any angle, walked as they
# are, leave them by less.
_BLOCK_CORRIDOR = 0.3
# A leg shorter than this share of the two half blocks at its ends is no piece of its own.
_SHORT_LEG = 0.1


@dataclass(frozen=True)
class SmoothedPath:
    """A smoothed path of m pieces.

    Attributes
    ----------
    corners
        The programmed path of n segments, and the blocks at its corners.
    pieces
        Nodes of the m pieces.
    segment : (m,) int64
        Programmed segment that each piece belongs to, ascending.
    share : (m,) float64
        Part of its segment's time that each piece takes where every leg is walked at constant speed and every block
        at a constant parametric one.
    corridor_mm : (m,) float64
        How far the motion may leave the chord of each piece.
    tolerance_mm
        Largest distance from the programmed path that the motion then has.
    """

    corners: SmoothedCorners
    pieces: ToolPath
    segment: NDArray[np.int64]
    share: FloatArray
    corridor_mm: FloatArray
    tolerance_mm: float

    def sums(self, values: FloatArray) -> FloatArray:
        """Sums (n,) over the pieces of each programmed segment."""
        return np.asarray(np.bincount(self.segment, values, minlength=self.corners.path.segments), dtype=np.float64)


def smoothed_path(path: ToolPath, tolerance_mm: float, corridor_mm: float, rounding_mm: float = 0.0) -> SmoothedPath:
    """Round the corners that slow the motion down, so that within its corridors it keeps the tolerance.

    The motion passes a sharp corner at full speed where a cubic through it stays within the corridor: its velocity
    across the segments there times a quarter of their time.

    Parameters
    ----------
    path
        As programmed.
    tolerance_mm
        Largest distance of the motion from it.
    corridor_mm
        How far the motion may leave the chord of a piece; narrower where the tolerance asks for it.
    rounding_mm
        How far a node may lie from where it should.
    """
    room_mm = tolerance_mm - rounding_mm
    wide_mm, narrow_mm = min(corridor_mm, room_mm), min(corridor_mm, _BLOCK_CORRIDOR * room_mm)
    corners = smooth_corners(path, room_mm, 1.0)
    # The middle of a block is farthest from the segments: by what it is from the corner, times a cosine.
    before, after = corners.before, corners.after
    cosine, sine = 0.5 * np.hypot(*(before + after)), 0.5 * np.hypot(*(after - before))
    shares = np.minimum(1.0, (1 - narrow_mm / room_mm) / np.maximum(cosine, 1e-12))
    corners = smooth_corners(path, room_mm, shares)
    slowing = 0.25 * sine * np.minimum(path.length_mm[1:], path.length_mm[:-1]) > wide_mm
    corners = replace(corners, transition_mm=np.where(slowing, corners.transition_mm, 0.0))
    return in_pieces(corners, tolerance_mm, wide_mm, narrow_mm)


def in_pieces(corners: SmoothedCorners, tolerance_mm: float, wide_mm: float, narrow_mm: float) -> SmoothedPath:
    """Cut a smoothed path into pieces, with a narrow corridor around the halves of blocks and a wide one elsewhere."""
    path, leg = corners.path, corners.leg_mm
    programmed = np.stack([path.x_mm, path.y_mm])
    move = np.diff(programmed, axis=1)
    along = np.divide(move, path.length_mm, out=np.zeros_like(move), where=path.length_mm > 0)
    transition = np.concatenate([[0.0], corners.transition_mm, [0.0]])
    before, after = transition[:-1], transition[1:]
    short = (before > 0) & (after > 0) & (leg < _SHORT_LEG * (before + after))
    nodes = programmed.copy()
    nodes[:, 1:-1] = np.where(corners.transition_mm > 0, corners.position_mm(0.5), programmed[:, 1:-1])
    # Each segment begins in the middle of a block, leaves it, and arrives at the next one.
    leave = programmed[:, :-1] + (before + np.where(short, 0.5 * leg, 0.0)) * along
    arrive = programmed[:, 1:] - after * along
    points = np.stack([nodes[:, :-1], leave, arrive], axis=-1)
    used = np.stack([np.ones_like(short), before > 0, (after > 0) & ~short], axis=-1)
    half = 0.5 * TANGENT_WEIGHT
    way = np.stack(
        [np.where(before > 0, half * before, leg), np.where(short, half * after, leg), half * after], axis=-1
    )
    way = np.where(used, way, 0.0)
    whole = way.sum(axis=-1, keepdims=True)
    share = np.divide(way, whole, out=used / used.sum(axis=-1, keepdims=True), where=whole > 0)
    segment = np.broadcast_to(np.arange(path.segments)[:, None], used.shape)
    halves = np.stack([before > 0, short, np.ones_like(short)], axis=-1)
    walked = np.concatenate([points[:, used], nodes[:, -1:]], axis=1)
    return SmoothedPath(
        corners,
        ToolPath(walked[0], walked[1]),
        segment[used],
        share[used],
        np.where(halves, narrow_mm, wide_mm)[used],
        tolerance_mm,
    )
