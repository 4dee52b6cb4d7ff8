"""The whole controller as a function of simulated time; sockets, text and clocks are elsewhere."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ibfctl_simulator.galil.axis import Axis, Motion
from ibfctl_simulator.galil.settings import SAMPLES_PER_SECOND, Settings
from ibfctl_simulator.galil.trace import TraceWriter

LETTERS = "ABCDEFGH"
OUTPUTS = 80
LARGEST_CHUNK_SAMPLES = 16384


class Controller:
    """Axes, inputs, outputs, the sample counter and the error latch.

    Attributes
    ----------
    samples
        Samples since power-up, which `TIME` reports.
    outputs
        Bit k-1 is output k.
    error_code
        Latched code that `TC` reports and clears.
    """

    def __init__(self, settings: Settings | None = None, trace: TraceWriter | None = None) -> None:
        self.settings = settings or Settings()
        self.axes = [Axis(letter, self.settings) for letter in LETTERS[: self.settings.axes]]
        self.samples = 0
        self.outputs = 0
        self.inputs = (1 << OUTPUTS) - 1 if self.settings.idle_inputs else 0
        self.error_code = 0
        self.variables: dict[str, float] = {}
        self._trace = trace
        self._time_setting = 1000.0
        self._epoch_s = 0.0
        self._epoch_sample = 0

    @property
    def time_setting(self) -> float:
        """Sample period as `TM` states it: nominal microseconds, 1000 for 1/1024 s."""
        return self._time_setting

    @property
    def sample_period_s(self) -> float:
        """True length of a sample in s."""
        return self._time_setting / (1000.0 * SAMPLES_PER_SECOND)

    def set_time_setting(self, setting: float) -> None:
        """Change the sample period from the present sample on."""
        self._epoch_s += (self.samples - self._epoch_sample) * self.sample_period_s
        self._epoch_sample = self.samples
        self._time_setting = setting
        for axis in self.axes:
            axis.sample_period_s = self.sample_period_s

    def advance_to(self, time_s: float) -> None:
        """Let all samples that end at or before the simulated time `time_s` pass."""
        due = self._epoch_sample + math.floor((time_s - self._epoch_s) / self.sample_period_s + 1e-6)
        if due > self.samples:
            self.advance(due - self.samples)

    def advance(self, samples: int) -> None:
        """Let `samples` samples pass."""
        while samples > 0:
            chunk = min(samples, LARGEST_CHUNK_SAMPLES)
            if not self.outputs and not any(axis.moving for axis in self.axes):
                chunk = samples  # nothing can change before the next command
            self._advance_chunk(chunk)
            samples -= chunk

    def set_output(self, number: int, on: bool) -> None:
        """Switch output `number` (from 1)."""
        bit = 1 << (number - 1)
        self.outputs = self.outputs | bit if on else self.outputs & ~bit

    def output(self, number: int) -> int:
        """State of output `number` (from 1)."""
        return self.outputs >> (number - 1) & 1

    def input(self, number: int) -> int:
        """Level of input `number` (from 1)."""
        return self.inputs >> (number - 1) & 1

    def _advance_chunk(self, samples: int) -> None:
        standing = [axis.commanded_counts for axis in self.axes]
        motions = [axis.advance(samples) for axis in self.axes]
        first = self.samples + 1
        self.samples += samples
        if self._trace is None or not (self.outputs or any(motions)):
            return
        rows = _rows_to_record(motions, samples, everything=bool(self.outputs))
        commanded = np.stack(
            [
                np.full(len(rows), position) if motion is None else motion.commanded_counts[rows]
                for position, motion in zip(standing, motions, strict=True)
            ],
            axis=1,
        )
        counts = np.rint(commanded).astype(np.int64)
        self._trace.append(first + rows, counts, counts, self.outputs)


def _rows_to_record(motions: list[Motion | None], samples: int, *, everything: bool) -> NDArray[np.int64]:
    if everything:
        return np.arange(samples)
    moving = np.zeros(samples, dtype=np.bool_)
    for motion in motions:
        if motion is not None:
            moving |= motion.moving
    return np.flatnonzero(moving)
