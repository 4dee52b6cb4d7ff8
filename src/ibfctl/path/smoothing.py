"""Corner smoothing: a cubic in place of every corner, within a contour tolerance.

A cubic Hermite block leaves one segment and joins the next at the same distance from their corner, tangent to both
(Essid et al. 2019, Int. J. Adv. Manuf. Technol. 105, Eqs. 2 to 13). It is what a Sinumerik inserts when it rounds a
linear path with a contour tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.path.tool_path import ToolPath

FloatArray = NDArray[np.float64]

# Weight of the tangents at both ends, as identified on a Sinumerik (section 4.1).
TANGENT_WEIGHT = 2.5
# Shares of the tolerance that a Sinumerik uses: where an axis reverses, and elsewhere (Eq. 31).
REVERSING_SHARE, OTHER_SHARE = 0.6, 0.8
# Up to this sine of half its angle a corner is none. From 150 degrees on the path turns back: a block would be a needle
# that any machine takes at a crawl, and a stop costs no more.
_STRAIGHT, _BACK = 1e-6, float(np.sin(np.radians(75)))
# Product of two directions that is rounding.
_ZERO = 1e-12
# The deviation in transition lengths and lengths of (after - before).
_SAGITTA = (4 - TANGENT_WEIGHT) / 8


@dataclass(frozen=True)
class SmoothedCorners:
    """A path whose corners are rounded. Arrays are over its n - 1 inner nodes.

    Attributes
    ----------
    path
        As programmed.
    transition_mm : (n - 1,) float64
        Distance from the node at which its block begins and ends; zero where there is none: where the path goes
        straight on, turns back by more than 150 degrees, or repeats a node.
    before, after : (2, n - 1) float64
        Unit vectors along the segments that meet at the node; zero for a repeated node.
    """

    path: ToolPath
    transition_mm: FloatArray
    before: FloatArray
    after: FloatArray

    @property
    def corner_mm(self) -> FloatArray:
        """Programmed positions, (2, n - 1)."""
        return np.stack([self.path.x_mm[1:-1], self.path.y_mm[1:-1]])

    @property
    def deviation_mm(self) -> FloatArray:
        """Distance of the middle of each block, its farthest point, from its corner, (n - 1,)."""
        return np.asarray(_SAGITTA * self.transition_mm * np.hypot(*(self.after - self.before)))

    @property
    def largest_deviation_mm(self) -> float:
        """Largest distance of the smoothed path from the programmed one."""
        return float(self.deviation_mm.max(initial=0.0))

    @property
    def leg_mm(self) -> FloatArray:
        """Straight rest of each segment, (n,)."""
        taken = np.concatenate([[0.0], self.transition_mm, [0.0]])
        return np.asarray(np.maximum(self.path.length_mm - taken[1:] - taken[:-1], 0.0))

    @cached_property
    def coefficients_mm(self) -> FloatArray:
        """Cubic of each block from the third power down, for a parameter from 0 to 1, (4, 2, n - 1) (Eq. 12)."""
        first, last = self.transition_mm * self.before, self.transition_mm * self.after
        both, weight = first + last, TANGENT_WEIGHT
        return np.stack(
            [(weight - 2) * both, 3 * both - weight * (2 * first + last), weight * first, self.corner_mm - first]
        )

    def position_mm(self, u: float | FloatArray) -> FloatArray:
        """Positions (2, n - 1) on the blocks at a parameter, one for all or (n - 1,)."""
        cubic, square, line, start = self.coefficients_mm
        return np.asarray(start + u * (line + u * (square + u * cubic)))


def smooth_corners(path: ToolPath, tolerance_mm: float, shares: float | FloatArray) -> SmoothedCorners:
    """Round the corners of a path.

    Parameters
    ----------
    path
        Nodes in mm.
    tolerance_mm
        Largest distance of the smoothed path from the programmed one.
    shares : float or (n - 1,) float64
        Share of the tolerance to use at each inner node, above 0 and up to 1; see `drive_shares`.

    Raises
    ------
    InputError
        If the tolerance or a share is out of range.
    """
    if not (np.isfinite(tolerance_mm) and tolerance_mm > 0):
        raise InputError(f"corner tolerance is {tolerance_mm:g} mm, it must be positive", "correct it; it is in mm")
    shares = np.broadcast_to(np.asarray(shares, dtype=np.float64), (path.segments - 1,))
    if not ((shares > 0) & (shares <= 1)).all():
        raise InputError("corner smoothing: a share of the tolerance is not above 0 and up to 1", "correct the shares")
    direction = _directions(path)
    before, after = direction[:, :-1], direction[:, 1:]
    turn = np.hypot(*(after - before))
    moving = (path.length_mm[:-1] > 0) & (path.length_mm[1:] > 0)
    rounded = moving & (turn > 2 * _STRAIGHT) & (turn < 2 * _BACK)
    wanted_mm = np.divide(shares * tolerance_mm, _SAGITTA * turn, out=np.zeros_like(turn), where=rounded)
    room_mm = 0.5 * np.minimum(path.length_mm[:-1], path.length_mm[1:])
    return SmoothedCorners(path, np.minimum(wanted_mm, room_mm), before, after)


def drive_shares(path: ToolPath) -> FloatArray:
    """Share of the tolerance that a Sinumerik uses at each inner node, (n - 1,)."""
    direction = _directions(path)
    reversing = (direction[:, :-1] * direction[:, 1:] < -_ZERO).any(axis=0)
    return np.where(reversing, REVERSING_SHARE, OTHER_SHARE)


def _directions(path: ToolPath) -> FloatArray:
    """Unit vectors along the segments, (2, n); zero where nothing moves."""
    move = np.stack([np.diff(path.x_mm), np.diff(path.y_mm)])
    length = path.length_mm
    return np.divide(move, length, out=np.zeros_like(move), where=length > 0)
