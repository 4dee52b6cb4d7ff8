"""Contour mode: straight lines between records, all contour axes in step."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from ibfctl_simulator.galil.profiles import FloatArray

RUNNING, STOPPED = 50, 51


@dataclass
class ContourQueue:
    """The records of one contour: counts per axis and a time that all axes share.

    Attributes
    ----------
    time_exponent
        `DT n`: a record takes 2^n samples; -1 pauses.
    """

    places: int
    time_exponent: int = 1
    waiting: dict[int, deque[tuple[int, int]]] = field(default_factory=dict)
    executed: int = 0

    @property
    def free(self) -> int:
        """Free places; all of them once the last record is done or being executed."""
        return self.places - max((len(records) for records in self.waiting.values()), default=0)


class ContourProfile:
    """Follows the records of one axis; holds while there are none."""

    def __init__(self, queue: ContourQueue, axis: int, position_counts: float, sample_period_s: float) -> None:
        self.position_counts = position_counts
        self.velocity_counts_s = 0.0
        self.end_code: int | None = None
        self._queue = queue
        self._records = queue.waiting[axis]
        self._counts_for_all = axis == min(queue.waiting)
        self._period_s = sample_period_s
        self._start_counts = position_counts
        self._active: tuple[int, int] | None = None
        self._taken = 0

    @property
    def busy(self) -> bool:
        """Whether a record is being or can be executed."""
        return self._active is not None or (bool(self._records) and self._queue.time_exponent >= 0)

    def look(self, samples: int) -> FloatArray:
        """Positions of the coming samples, up to the end of the present record."""
        record = self._active or (self._records[0] if self.busy else None)
        if record is None:
            return np.full(samples, self._start_counts)
        move, time = record
        if time == 0:
            return np.empty(0)
        last = min(time, self._taken + samples)
        return self._start_counts + move * np.arange(self._taken + 1, last + 1) / time

    def take(self, samples: int) -> None:
        """Consume samples."""
        if self._active is None:
            if not self.busy:
                return
            self._active = self._records.popleft()
        move, time = self._active
        if time == 0:
            self._records.clear()
            self.velocity_counts_s, self.end_code = 0.0, STOPPED
            return
        self._taken += samples
        self.velocity_counts_s = move / (time * self._period_s)
        self.position_counts = self._start_counts + move * self._taken / time
        if self._taken >= time:
            self._start_counts += move
            self._queue.executed += self._counts_for_all
            self.position_counts = self._start_counts
            self._active, self._taken = None, 0
            if not self.busy:
                self.velocity_counts_s = 0.0

    def abandon(self) -> None:
        """Lose the waiting records of this axis."""
        self._records.clear()
