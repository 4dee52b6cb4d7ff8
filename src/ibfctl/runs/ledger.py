"""The host's own account of the buffer in seconds: when it would run dry, when the motion will end."""

from __future__ import annotations

import math

import numpy as np

from ibfctl.machine.program import MotionProgram


class SegmentLedger:
    """Account of segments sent and executed against the host's monotonic clock.

    Every bound errs towards too little: of the segment being executed nothing is counted as left, and a
    count is taken to be as old as the question that it answers.

    Parameters
    ----------
    program
        The program being streamed.
    time_scale
        Controller seconds per host second: 1, but for an emulated clock.

    Attributes
    ----------
    sent, executed
        Segments of the program, without the end marker.
    minimum_margin_s
        Least motion surely left in the buffer, in controller seconds, while there was more to send.
    latest_end_at
        Latest moment, on the host's clock, at which the program can be over if it is fed in time.
    """

    def __init__(self, program: MotionProgram, time_scale: float) -> None:
        self._time_scale = time_scale
        self.replace(program)
        self._asked_at = math.inf
        self._surely_begun = 0
        self._began_at = math.inf
        self.sent = 0
        self.executed = 0
        self.minimum_margin_s = math.inf

    def replace(self, program: MotionProgram) -> None:
        """Go on with a program that differs only in what has not been sent."""
        self._ends_s = np.concatenate([[0.0], np.cumsum(program.time_samples)]) * program.sample_period_s
        self._total = len(program)
        self.latest_end_at = math.inf

    def within(self, ahead_s: float, at_least: int) -> int:
        """How many segments in all may be sent, so that `ahead_s` controller seconds or `at_least` segments wait."""
        last = int(np.searchsorted(self._ends_s, self._ends_s[self.executed] + ahead_s, side="right")) - 1
        return min(max(last, self.executed + at_least), self._total)

    def begin(self, now: float) -> None:
        """Note that the motion begins at `now` or later."""
        self._began_at = self._asked_at = now
        self.minimum_margin_s = self.margin_s(now)

    def add(self, segments: int, now: float) -> None:
        """Note that `segments` more were accepted by `now`; the margin before they came is what counts."""
        self.minimum_margin_s = min(self.minimum_margin_s, self.margin_s(now))
        self.sent += segments

    def count(self, executed: int, asked_at: float, answered_at: float) -> None:
        """Note that `executed` segments were over at some moment between question and answer."""
        executed = min(executed, self._total)
        if executed > self.executed or self.latest_end_at == math.inf:
            left_s = float(self._ends_s[self._total] - self._ends_s[executed]) / self._time_scale
            self.latest_end_at = answered_at + left_s  # a count that stands still must not put it off
        self.executed = executed
        self._surely_begun = min(executed + 1, self._total)
        self._asked_at = asked_at

    @property
    def dry_at(self) -> float:
        """Earliest moment at which the buffer can be empty."""
        left_s = self._ends_s[self.sent] - self._ends_s[min(self._surely_begun, self.sent)]
        return self._asked_at + float(left_s) / self._time_scale

    def margin_s(self, now: float) -> float:
        """Motion surely left in the buffer at `now`, in controller seconds."""
        return (self.dry_at - now) * self._time_scale

    def behind_s(self, now: float) -> float:
        """Host seconds by which the controller surely lags behind the program's times."""
        return now - self._began_at - float(self._ends_s[self._surely_begun]) / self._time_scale
