"""Motion through the blocks that round corners: the speed that their limits allow, and steps of limited jerk.

Essid et al. 2019, Int. J. Adv. Manuf. Technol. 105, Eqs. 16 to 30. As there, the radial jerk bounds the speed at the
ends of a block (Eq. 26). The other limits are kept all along it: its curvature is largest in its middle, and who only
looks at its beginning arrives there too fast.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.schedule.kinematics_drive import Drive

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# What may bind in a block, the axis x before y for each.
BLOCK_LIMITS = ("speed", "tangential acceleration", "radial acceleration", "tangential jerk", "radial jerk")
# Places along a block at which its speed limit is taken.
_PLACES = 17
# Part of a limit that is rounding.
_SLACK = 1e-9
# A block that is short, or slow, for the sampling is stepped more finely: in at least so many parts of its tangent's
# length, and so that the jerk changes the speed by no more than such a share in a step.
_PARTS, _CHANGE = 8, 0.1
# Share of its entry speed below which no block is crossed.
_LEAST = 0.5
# Blocks that are stepped together: their arrays stay in the processor's cache.
_TOGETHER = 8192


@dataclass(frozen=True)
class Place:
    """Geometry of m blocks at a parameter u (Eqs. 20 to 23).

    Attributes
    ----------
    sigma, sigma1, sigma2 : (m,) float64
        Length per u and its derivatives by u, mm.
    curvature, growth : (m,) float64
        Curvature in 1/mm and its derivative along the path in 1/mm², signed.
    tangent : (2, m) float64
        Magnitudes of the components of the unit vector along the path; those of the normal are the same, swapped.
    """

    sigma: FloatArray
    sigma1: FloatArray
    sigma2: FloatArray
    curvature: FloatArray
    growth: FloatArray
    tangent: FloatArray

    def __getitem__(self, chosen: IntArray) -> Place:
        return Place(
            self.sigma[chosen], self.sigma1[chosen], self.sigma2[chosen], self.curvature[chosen], self.growth[chosen],
            self.tangent[:, chosen],
        )  # fmt: skip

    def along(self, limit: FloatArray) -> FloatArray:
        """Magnitude along the path, (m,), that keeps both axes within `limit` (2, 1)."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.minimum(limit[0] / self.tangent[0], limit[1] / self.tangent[1]))

    def across(self, limit: FloatArray) -> FloatArray:
        """Magnitude across the path, (m,), that keeps both axes within `limit` (2, 1)."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.minimum(limit[0] / self.tangent[1], limit[1] / self.tangent[0]))


@dataclass(frozen=True)
class Blocks:
    """The smoothing blocks of a path, m of them.

    Attributes
    ----------
    line, square, cubic : (2, m) float64
        Coefficients of their cubics in mm, without the constant.
    drive
        Limits.
    """

    line: FloatArray
    square: FloatArray
    cubic: FloatArray
    drive: Drive

    def __getitem__(self, chosen: IntArray) -> Blocks:
        return Blocks(self.line[:, chosen], self.square[:, chosen], self.cubic[:, chosen], self.drive)

    def at(self, u: float | FloatArray) -> Place:
        """Geometry at a parameter from 0 to 1, one for all or (m,)."""
        first = self.line + u * (2 * self.square + 3 * u * self.cubic)
        second = 2 * self.square + 6 * u * self.cubic
        third = 6 * self.cubic
        sigma = np.hypot(first[0], first[1])
        sigma1 = _dot(first, second) / sigma
        sigma2 = (_dot(second, second) + _dot(first, third) - sigma1**2) / sigma
        curvature = _cross(first, second) / sigma**3
        growth = (_cross(first, third) / sigma**3 - 3 * curvature * sigma1 / sigma) / sigma
        return Place(sigma, sigma1, sigma2, curvature, growth, np.abs(first / sigma))

    def speed_bounds(self, u: float) -> FloatArray:
        """Speeds that keep each of `BLOCK_LIMITS` at a place without acceleration along the path, (5, m) (Eq. 26)."""
        place, drive = self.at(u), self.drive
        bent = np.abs(place.curvature)
        at_end = u in (0.0, 1.0)
        unbound = np.full_like(bent, np.inf)
        with np.errstate(divide="ignore"):
            return np.stack(
                [
                    place.along(drive.speed_mm_s),
                    unbound,
                    np.sqrt(place.across(drive.radial_mm_s2) / bent),
                    np.cbrt(place.along(drive.tangential_mm_s3) / bent**2),
                    np.cbrt(place.across(drive.radial_mm_s3) / np.abs(place.growth)) if at_end else unbound,
                ]
            )

    def speed_limits(self) -> tuple[FloatArray, IntArray]:
        """Largest constant speed from each of several places on to the end, (places, m); what sets the first, (m,).

        The second is an index of `BLOCK_LIMITS`.
        """
        bounds = np.stack([self.speed_bounds(u) for u in np.linspace(0.0, 1.0, _PLACES).tolist()])
        binding = bounds.min(axis=0).argmin(axis=0)
        return np.minimum.accumulate(bounds.min(axis=1)[::-1], axis=0)[::-1], binding


@dataclass(frozen=True)
class Step:
    """A sample of the motion of some blocks.

    Attributes
    ----------
    block : (k,) int64
        Which blocks.
    u, speed_mm_s, acceleration_mm_s2, time_s : (k,) float64
        Where each is after the sample, how it moves along the path there, and how long the sample took.
    """

    block: IntArray
    u: FloatArray
    speed_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    time_s: FloatArray


def traverse(
    blocks: Blocks, entry_mm_s: FloatArray, limits_mm_s: FloatArray, steps: list[Step] | None = None
) -> tuple[FloatArray, FloatArray]:
    """Move through blocks with the largest jerk along the path, none, or the largest negative one in each sample.

    The first of the three that keeps the limits is taken (Eq. 30 and the algorithm after it). Eq. 29 subtracts what
    the parametrisation itself adds to the jerk from what is allowed, which leaves nothing where it is the larger; here
    it is compensated.

    Parameters
    ----------
    blocks
        m of them.
    entry_mm_s : (m,) float64
        Speed at the start, without acceleration along the path (Eq. 28).
    limits_mm_s : (places, m) float64
        Highest speed from a place on, never falling along a block.
    steps
        Takes the samples.

    Returns
    -------
    time_s, exit_mm_s : (m,) float64
        Duration, and speed at the end.
    """
    time_s, exit_mm_s = np.zeros(entry_mm_s.size), entry_mm_s.copy()
    moving = np.flatnonzero(entry_mm_s > 0)
    for first in range(0, moving.size, _TOGETHER):
        chosen = moving[first : first + _TOGETHER]
        for step in _steps(blocks[chosen], entry_mm_s[chosen], limits_mm_s[:, chosen]):
            here = chosen[step.block]
            time_s[here] += step.time_s
            exit_mm_s[here] = step.speed_mm_s
            if steps is not None:
                steps.append(replace(step, block=here))
    return time_s, exit_mm_s


def _steps(blocks: Blocks, entry_mm_s: FloatArray, limits_mm_s: FloatArray) -> Iterator[Step]:
    """Yield the samples of blocks until all have ended."""
    drive, here = blocks.drive, blocks.at(0.0)
    active, limits, least = np.arange(entry_mm_s.size), limits_mm_s, _LEAST * entry_mm_s
    sample_s = np.minimum(drive.sample_s, here.sigma / entry_mm_s / _PARTS)
    sample_s = np.minimum(sample_s, np.sqrt(2 * _CHANGE * entry_mm_s / here.along(drive.tangential_mm_s3)))
    u, speed, push = np.zeros(active.size), entry_mm_s, np.zeros(active.size)
    while active.size:
        # Parametric velocity, acceleration and jerk (Eq. 23 solved for them), the last without a jerk along the path.
        first = speed / here.sigma
        second = (push - here.sigma1 * first**2) / here.sigma
        third = (speed**3 * here.curvature**2 - here.sigma2 * first**3 - 3 * here.sigma1 * first * second) / here.sigma
        jerk = here.along(drive.tangential_mm_s3)
        new_u = u + sample_s * (first + sample_s * (second / 2 + sample_s * third / 6))
        place = blocks.at(np.minimum(new_u, 1.0))
        highest = limits[(u * (_PLACES - 1)).astype(np.int64), np.arange(active.size)] * (1 + _SLACK)
        most_push = np.minimum(
            place.along(drive.tangential_mm_s2),
            place.across(drive.radial_mm_s3) / np.maximum(np.abs(3 * speed * place.curvature), 1e-300),
        )
        factor = np.full(active.size, -1.0)
        for tried in (0.0, 1.0):
            new_speed, new_push = _moved(place, first, second, third + tried * jerk / here.sigma, sample_s)
            # Speed that is still gained while the acceleration goes back to none.
            gained = np.maximum(new_push, 0.0) ** 2 / (2 * jerk)
            allowed = (np.abs(new_push) <= most_push) & (new_speed + gained <= highest)
            factor = np.where(allowed, tried, factor)
        new_speed, new_push = _moved(place, first, second, third + factor * jerk / here.sigma, sample_s)
        too_slow = new_speed < least
        new_speed, new_push = np.where(too_slow, least, new_speed), np.where(too_slow, 0.0, new_push)
        # The last sample ends with the block.
        share = np.minimum((1 - u) / (new_u - u), 1.0)
        reached = speed + share * (new_speed - speed), push + share * (new_push - push)
        yield Step(active, np.minimum(new_u, 1.0), *reached, sample_s * share)
        left = np.flatnonzero(new_u < 1)
        active, u, speed, push = active[left], new_u[left], new_speed[left], new_push[left]
        blocks, limits, least, here = blocks[left], limits[:, left], least[left], place[left]
        sample_s = sample_s[left]


def _moved(
    place: Place, first: FloatArray, second: FloatArray, third: FloatArray, sample_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Speed and acceleration along the path at `place` after a sample of constant parametric jerk (Eqs. 16, 23)."""
    velocity = first + sample_s * (second + 0.5 * sample_s * third)
    return place.sigma * velocity, place.sigma1 * velocity**2 + place.sigma * (second + sample_s * third)


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(one[0] * other[0] + one[1] * other[1])


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(one[0] * other[1] - one[1] * other[0])
