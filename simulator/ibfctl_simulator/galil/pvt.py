"""PVT: a buffer of segments per axis, each executed as one cubic, sample by sample.

With T the time of a segment, p its move, v0 the velocity it inherits and v its end velocity,
position and velocity at u = tau/T are

    s(u)     = v0 T u + (3 p - (2 v0 + v) T) u^2 + ((v0 + v) T - 2 p) u^3
    ds/dt(u) = (v0 T + 2 (3 p - (2 v0 + v) T) u + 3 ((v0 + v) T - 2 p) u^2) / T

so that s(1) = p and ds/dt(1) = v exactly.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from ibfctl_simulator.galil.profiles import FloatArray

RUNNING, COMPLETE, UNDERRUN = 30, 31, 32


class Segment(NamedTuple):
    """Move in counts, end velocity in counts/s, time in samples; time 0 is the end marker."""

    move_counts: int
    end_velocity_counts_s: int
    time_samples: int


class PvtBuffer:
    """The waiting segments of one axis, and how many were executed since the last begin."""

    def __init__(self, places: int) -> None:
        self.places = places
        self.waiting: deque[Segment] = deque()
        self.executed = 0
        self.lose_next = 0
        """How many of the next segments a fault loses without a word."""

    def add(self, segment: Segment) -> None:
        """Queue a segment."""
        if self.lose_next and segment.time_samples:
            self.lose_next -= 1
        else:
            self.waiting.append(segment)

    @property
    def free(self) -> int:
        """Free places; the segment being executed is not counted as waiting."""
        return self.places - len(self.waiting)

    def clear(self) -> None:
        """Forget the waiting segments."""
        self.waiting.clear()


class PvtProfile:
    """Executes the segments of a buffer from the present position on, starting at rest."""

    def __init__(self, buffer: PvtBuffer, position_counts: float, sample_period_s: float) -> None:
        self.position_counts = position_counts
        self.velocity_counts_s = 0.0
        self.end_code: int | None = None
        self._buffer = buffer
        self._period_s = sample_period_s
        self._active: Segment | None = None
        self._taken = 0
        self._start_counts = position_counts
        self._start_velocity = 0.0
        buffer.executed = 0
        self._end_at_marker()

    @property
    def busy(self) -> bool:
        """Always true: even without segments the axis is in its last sample of PVT."""
        return True

    def look(self, samples: int) -> FloatArray:
        """Positions of the coming samples; none left means that the buffer ran empty."""
        segments = self._within(samples)
        if not segments:
            return np.empty(0)
        move, velocity, time = np.array(segments, dtype=np.float64).T
        inherited = np.concatenate(([self._start_velocity], velocity[:-1]))
        start = self._start_counts + np.concatenate(([0.0], np.cumsum(move[:-1])))
        period = time * self._period_s
        linear = inherited * period
        square = 3.0 * move - (2.0 * inherited + velocity) * period
        cube = (inherited + velocity) * period - 2.0 * move
        count = time.astype(np.int64)
        first = np.concatenate(([0], np.cumsum(count[:-1])))
        total = int(count.sum())
        last = min(self._taken + samples, total)
        which = np.repeat(np.arange(len(segments)), count)[self._taken : last]
        u = (np.arange(self._taken + 1, last + 1) - first[which]) / time[which]
        positions: FloatArray = start[which] + u * (linear[which] + u * (square[which] + u * cube[which]))
        return positions

    def take(self, samples: int) -> None:
        """Consume samples; taking none when nothing is left ends the profile by underrun."""
        waiting = self._buffer.waiting
        if self._active is None:
            if self._end_at_marker():
                return
            if not waiting:
                self.end_code = UNDERRUN
                return
            self._active = waiting.popleft()
        self._taken += samples
        while self._active is not None and self._taken >= self._active.time_samples:
            self._taken -= self._active.time_samples
            self._start_counts += self._active.move_counts
            self._start_velocity = float(self._active.end_velocity_counts_s)
            self._buffer.executed += 1
            self._active = None
            self.position_counts = self._start_counts
            self.velocity_counts_s = self._start_velocity
            if self._end_at_marker():
                return
            if self._taken:
                self._active = waiting.popleft()
        if self._active is not None:
            self._follow(self._active)

    def abandon(self) -> None:
        """Lose the waiting segments."""
        self._buffer.clear()

    def samples_until(self, executed: int) -> int:
        """Samples until the buffer has executed that many segments, or all that it holds."""
        left, count = 0, self._buffer.executed
        if self._active is not None:
            left, count = self._active.time_samples - self._taken, count + 1
        for segment in self._buffer.waiting:
            if count >= executed:
                break
            left, count = left + segment.time_samples, count + 1
        return max(left, 1)

    def _within(self, samples: int) -> list[Segment]:
        """Segments that cover the coming samples, the active one first, up to the end marker."""
        needed = self._taken + samples
        chosen = [] if self._active is None else [self._active]
        covered = sum(segment.time_samples for segment in chosen)
        for segment in self._buffer.waiting:
            if covered >= needed or segment.time_samples == 0:
                break
            chosen.append(segment)
            covered += segment.time_samples
        return chosen

    def _end_at_marker(self) -> bool:
        waiting = self._buffer.waiting
        if not waiting or waiting[0].time_samples:
            return False
        # The marker counts as executed; what was queued behind it is lost.
        self._buffer.executed += 1
        self._buffer.clear()
        self.velocity_counts_s = 0.0
        self.end_code = COMPLETE
        return True

    def _follow(self, segment: Segment) -> None:
        period = segment.time_samples * self._period_s
        u = self._taken / segment.time_samples
        linear = self._start_velocity * period
        move, velocity = segment.move_counts, segment.end_velocity_counts_s
        square = 3.0 * move - (2.0 * self._start_velocity + velocity) * period
        cube = (self._start_velocity + velocity) * period - 2.0 * move
        self.position_counts = self._start_counts + u * (linear + u * (square + u * cube))
        self.velocity_counts_s = (linear + u * (2.0 * square + u * 3.0 * cube)) / period
