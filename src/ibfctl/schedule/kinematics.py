"""The time that a numerically controlled machine takes for a path with rounded corners, and how its axes move.

Straight legs in up to seven phases, blocks at the corners by limited parametric jerk (Essid et al. 2019, Int. J. Adv.
Manuf. Technol. 105, section 3). The speeds between them are the highest from which every later limit can be kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.path.smoothing import SmoothedCorners
from ibfctl.schedule.kinematics_blocks import BLOCK_LIMITS, Blocks, traverse
from ibfctl.schedule.kinematics_drive import Drive
from ibfctl.schedule.kinematics_line import Lines

FloatArray = NDArray[np.float64]

# What may set the speed in a block: its own limits, the programmed feed, the legs on its sides; or there is no block.
CORNER_LIMITS = (*BLOCK_LIMITS, "feed", "leg", "no block")

# Change of a speed, relative to the feed, below which the sweeps along the path are done.
_SETTLED = 1e-9
# Part of a speed that is rounding.
_SLACK = 1e-6


@dataclass(frozen=True)
class CornerTiming:
    """Speeds and times along a smoothed path of n segments.

    Attributes
    ----------
    corners, drive
        What was timed.
    feed_mm_s : (n,) float64
        Programmed feed rate of each segment.
    entry_mm_s, exit_mm_s : (n - 1,) float64
        Speed where each block begins and ends; where there is none, that at the node.
    leg_s : (n,) float64
        Time on the straight rest of each segment.
    block_s : (n - 1,) float64
        Time in each block.
    binding : (n - 1,) int64
        What sets the speed where each block begins: an index of `CORNER_LIMITS`.
    speed_limits_mm_s : (places, blocks) float64
        Highest speed from places along each block on, in the order of the nodes that have one.
    """

    corners: SmoothedCorners
    drive: Drive
    feed_mm_s: FloatArray
    entry_mm_s: FloatArray
    exit_mm_s: FloatArray
    leg_s: FloatArray
    block_s: FloatArray
    binding: NDArray[np.int64]
    speed_limits_mm_s: FloatArray

    @property
    def cycle_time_s(self) -> float:
        """Time of the whole path, from rest to rest."""
        return float(self.leg_s.sum() + self.block_s.sum())


def time_corners(corners: SmoothedCorners, drive: Drive, feed_mm_s: float | FloatArray) -> CornerTiming:
    """Time a smoothed path at a programmed feed rate, one or (n,), from rest to rest.

    Raises
    ------
    InputError
        If a feed rate is no positive number.
    """
    feed_mm_s = np.array(np.broadcast_to(feed_mm_s, (corners.path.segments,)), dtype=np.float64)
    if not (np.isfinite(feed_mm_s) & (feed_mm_s > 0)).all():
        raise InputError("a feed rate is no positive number", "correct it; it is in mm/s")
    lines = lines_of(corners, drive, feed_mm_s)
    rounded = np.flatnonzero(corners.transition_mm > 0)
    blocks = blocks_of(corners, drive)[rounded]
    own, limit_name = blocks.speed_limits()
    # At a corner the lower of the feeds on its two sides.
    feed = np.minimum(feed_mm_s[1:], feed_mm_s[:-1])
    limits = np.minimum(own, feed[rounded])
    # Without a block: a stop where the path turns, no limit where it goes straight on.
    node = np.where(corners.path.straight, feed, 0.0)
    node[rounded] = limits[0]
    entry, leaving = _braked(node, lines)
    limits = np.minimum(limits, leaving[rounded])
    # At first as if every block were left as fast as it is entered.
    block_s, exit_mm_s = np.zeros(node.size), entry.copy()
    previous = np.full(node.size, -1.0)
    while True:
        possible = np.minimum(entry, lines[:-1].reach(np.concatenate([[0.0], exit_mm_s[:-1]])))
        changed = np.abs(possible - previous) > _SETTLED * feed_mm_s.max()
        if not changed.any():
            break
        previous = np.where(changed, possible, previous)
        exit_mm_s = np.where(changed, previous, exit_mm_s)
        again = np.flatnonzero(changed[rounded])
        nodes = rounded[again]
        block_s[nodes], exit_mm_s[nodes] = traverse(blocks[again], previous[nodes], limits[:, again])
    binding = np.full(node.size, CORNER_LIMITS.index("no block"))
    binding[rounded] = np.where(own[0] < feed[rounded], limit_name, CORNER_LIMITS.index("feed"))
    held_back = previous < node * (1 - _SLACK)
    binding[rounded] = np.where(held_back[rounded], CORNER_LIMITS.index("leg"), binding[rounded])
    leg_s = lines.time_s(np.concatenate([[0.0], exit_mm_s]), np.concatenate([previous, [0.0]]))
    return CornerTiming(corners, drive, feed_mm_s, previous, exit_mm_s, leg_s, block_s, binding, limits)


def blocks_of(corners: SmoothedCorners, drive: Drive) -> Blocks:
    """Blocks at all inner nodes."""
    cubic, square, line, _ = corners.coefficients_mm
    return Blocks(line, square, cubic, drive)


def lines_of(corners: SmoothedCorners, drive: Drive, feed_mm_s: FloatArray) -> Lines:
    """Legs of all segments, with the limits of the axes along each."""
    move = np.abs(np.stack([np.diff(corners.path.x_mm), np.diff(corners.path.y_mm)]))
    length = corners.path.length_mm
    share = np.divide(move, length, out=np.ones_like(move), where=length > 0)

    def along(limits: tuple[float, float]) -> FloatArray:
        with np.errstate(divide="ignore"):
            return np.asarray((np.array(limits)[:, None] / share).min(axis=0))

    speed = np.minimum(feed_mm_s, along(drive.v_max_mm_s))
    return Lines(corners.leg_mm, speed, along(drive.a_max_mm_s2), along(drive.j_max_mm_s3))


def _braked(node_mm_s: FloatArray, lines: Lines) -> tuple[FloatArray, FloatArray]:
    """Highest speeds to enter and to leave the inner nodes with, (n - 1,) each, so that all that follows is kept."""
    entry = np.minimum(node_mm_s, lines[:-1].v_max_mm_s)
    while True:
        leaving = lines[1:].reach(np.concatenate([entry[1:], [0.0]]))
        lower = np.minimum(entry, leaving)
        if (lower == entry).all():
            return entry, leaving
        entry = lower
