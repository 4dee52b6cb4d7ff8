"""What a numerically controlled machine allows its axes, along lines and through the blocks that round corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.machine.description import MachineDescription

FloatArray = NDArray[np.float64]
Pair = tuple[float, float]

# Of the drive of Table 2: time to its acceleration, and jerk in a transition relative to that on a line.
_RISE_S, _TRANSITION_SHARE = 1 / 15, 2 / 3


@dataclass(frozen=True)
class Drive:
    """Limits of the axes x and y (Essid et al. 2019, Eqs. 14, 15 and 18; Table 2). Pairs are (x, y).

    Attributes
    ----------
    v_max_mm_s, a_max_mm_s2, j_max_mm_s3 : pair of float
        Speed, acceleration, and jerk on straight lines.
    transition_j_max_mm_s3 : pair of float
        Jerk in the blocks that round corners.
    radial_acceleration_share, radial_jerk_share
        Shares R_A and R_J of a block's acceleration and jerk that go across the path, between 0 and 1.
    cycle_s, sampling_factor
        Cycle time of the interpolator, and the part of it after which it samples, above 0 and up to 1.
    """

    v_max_mm_s: Pair
    a_max_mm_s2: Pair
    j_max_mm_s3: Pair
    transition_j_max_mm_s3: Pair
    radial_acceleration_share: float = 0.2
    radial_jerk_share: float = 0.2
    cycle_s: float = 0.008
    sampling_factor: float = 1.0

    def __post_init__(self) -> None:
        limits = (*self.v_max_mm_s, *self.a_max_mm_s2, *self.j_max_mm_s3, *self.transition_j_max_mm_s3, self.cycle_s)
        shares = (self.radial_acceleration_share, self.radial_jerk_share)
        if not all(0 < limit < np.inf for limit in limits):
            raise InputError("drive: speeds, accelerations, jerks and cycle time must be positive", "correct them")
        if not (all(0 < share < 1 for share in shares) and 0 < self.sampling_factor <= 1):
            raise InputError(
                "drive: radial shares must lie between 0 and 1, the sampling factor above 0 and up to 1", "correct them"
            )

    @property
    def sample_s(self) -> float:
        """Sampling time (Eq. 18)."""
        return self.sampling_factor * self.cycle_s

    @property
    def speed_mm_s(self) -> FloatArray:
        """Largest speed of each axis, (2, 1)."""
        return _column(self.v_max_mm_s, 1.0)

    @property
    def radial_mm_s2(self) -> FloatArray:
        """Acceleration across the path, (2, 1) (Eq. 14)."""
        return _column(self.a_max_mm_s2, self.radial_acceleration_share)

    @property
    def tangential_mm_s2(self) -> FloatArray:
        """Acceleration along the path, (2, 1) (Eq. 14)."""
        return _column(self.a_max_mm_s2, 1 - self.radial_acceleration_share)

    @property
    def radial_mm_s3(self) -> FloatArray:
        """Jerk across the path, (2, 1) (Eq. 15)."""
        return _column(self.transition_j_max_mm_s3, self.radial_jerk_share)

    @property
    def tangential_mm_s3(self) -> FloatArray:
        """Jerk along the path, (2, 1) (Eq. 15)."""
        return _column(self.transition_j_max_mm_s3, 1 - self.radial_jerk_share)


def drive_of(machine: MachineDescription) -> Drive:
    """Return the drive of a machine file; where it has no limit of the jerk, one that fits its acceleration."""
    x, y = machine.axis_of("x"), machine.axis_of("y")
    jerk = tuple(axis.j_max_mm_s3 or axis.a_max_mm_s2 / _RISE_S for axis in (x, y))
    return Drive(
        (x.v_max_mm_s, y.v_max_mm_s),
        (x.a_max_mm_s2, y.a_max_mm_s2),
        (jerk[0], jerk[1]),
        (_TRANSITION_SHARE * jerk[0], _TRANSITION_SHARE * jerk[1]),
    )


def _column(pair: Pair, share: float) -> FloatArray:
    return share * np.array(pair)[:, None]
