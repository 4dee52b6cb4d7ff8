"""What the controller is given: integers, one row per segment and axis.

PVT programs are what the planner makes. Contour programs (straight lines, durations of 2^n samples only) are for
motion that comes from elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

MAX_SEGMENT_SAMPLES = 2048
MAX_INCREMENT_COUNTS = 44_000_000
MAX_VELOCITY_COUNTS_S = 22_000_000
MAX_CONTOUR_COUNTS = 32_000
MAX_CONTOUR_EXPONENT = 8


def seconds(samples: IntArray, sample_period_s: float) -> FloatArray:
    """Durations in seconds, of the shape of `samples`."""
    return np.asarray(samples * sample_period_s, dtype=np.float64)


@dataclass(frozen=True)
class AxisProgram:
    """One axis of a PVT program.

    Attributes
    ----------
    increment_counts : (n,) int64
        Move of each segment relative to the end of the one before.
    end_velocity_counts_s : (n,) int64
        Velocity at the end of each segment; the start velocity is inherited, zero at first.
    start_counts : int
        Absolute position from which the first segment starts.
    counts_per_mm : float
        Signed: negative where the axis counts against its coordinate.
    """

    increment_counts: IntArray
    end_velocity_counts_s: IntArray
    start_counts: int
    counts_per_mm: float

    @property
    def start_mm(self) -> float:
        """Position of the start on the count grid, in mm."""
        return self.start_counts / self.counts_per_mm

    @property
    def end_counts(self) -> int:
        """Absolute position at the end of the last segment."""
        return self.start_counts + int(self.increment_counts.sum())


@dataclass(frozen=True)
class PvtProgram:
    """A quantised PVT program; all axes share the times of their segments.

    Attributes
    ----------
    axes : mapping of axis letter to AxisProgram
    coordinates : mapping of coordinate ("x", "y") to axis letter
    time_samples : (n,) int64
        Duration of each segment, even, 2 to 2048 samples.
    sample_period_s : float
        Length of one controller sample; 1/1024 s at Galil's default TM 1000.
    """

    RUNNING_CODE: ClassVar[int] = 30
    COMPLETE_CODE: ClassVar[int] = 31

    axes: Mapping[str, AxisProgram]
    coordinates: Mapping[str, str]
    time_samples: IntArray
    sample_period_s: float

    def __len__(self) -> int:
        return int(self.time_samples.size)

    @property
    def time_s(self) -> FloatArray:
        """Duration of each segment, (n,)."""
        return seconds(self.time_samples, self.sample_period_s)

    @property
    def total_time_s(self) -> float:
        """Duration from the first sample to rest at the end."""
        return float(self.time_samples.sum() * self.sample_period_s)

    def axis_of(self, coordinate: str) -> AxisProgram:
        """Return the axis program that moves `coordinate` ("x" or "y")."""
        return self.axes[self.coordinates[coordinate]]


@dataclass(frozen=True)
class ContourAxis:
    """One axis of a contour program.

    Attributes
    ----------
    increment_counts : (n,) int64
        Move of each segment, at constant velocity.
    start_counts : int
        Absolute position from which the first segment starts.
    counts_per_mm : float
        Signed: negative where the axis counts against its coordinate.
    """

    increment_counts: IntArray
    start_counts: int
    counts_per_mm: float

    @property
    def end_counts(self) -> int:
        """Absolute position at the end of the last segment."""
        return self.start_counts + int(self.increment_counts.sum())


@dataclass(frozen=True)
class ContourProgram:
    """A contour program; all axes share the times of their segments.

    Attributes
    ----------
    axes : mapping of axis letter to ContourAxis
    coordinates : mapping of coordinate ("x", "y") to axis letter
    time_exponents : (n,) int64
        A segment lasts 2^n samples, with n from 1 to 8.
    sample_period_s : float
        Length of one controller sample.
    """

    RUNNING_CODE: ClassVar[int] = 50
    COMPLETE_CODE: ClassVar[int] = 51

    axes: Mapping[str, ContourAxis]
    coordinates: Mapping[str, str]
    time_exponents: IntArray
    sample_period_s: float

    def __len__(self) -> int:
        return int(self.time_exponents.size)

    @property
    def time_samples(self) -> IntArray:
        """Duration of each segment, (n,) int64."""
        return np.left_shift(np.int64(1), self.time_exponents)

    @property
    def total_time_s(self) -> float:
        """Duration from the first sample to rest at the end."""
        return float(self.time_samples.sum() * self.sample_period_s)


MotionProgram: TypeAlias = PvtProgram | ContourProgram
