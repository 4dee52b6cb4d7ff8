"""What the controller is: axes, inputs, outputs, sample counter, error latch, variables."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ibfctl_simulator.galil.axis import Axis
from ibfctl_simulator.galil.contour import ContourQueue
from ibfctl_simulator.galil.outlook import Motion
from ibfctl_simulator.galil.settings import SAMPLES_PER_SECOND, Settings
from ibfctl_simulator.galil.trace import TraceWriter

LETTERS = "ABCDEFGH"
OUTPUTS = INPUTS = 80
ANALOG_INPUTS = 8
LARGEST_CHUNK_SAMPLES = 16384


class State:
    """The controller without its text: commands act on it, and samples pass over it.

    Attributes
    ----------
    sample
        Samples since the emulator was started; a reset does not change it.
    outputs, inputs
        Bit k-1 is output or input k.
    error_code
        Latched code that `TC` reports and clears.
    """

    def __init__(self, settings: Settings, trace: TraceWriter | None = None) -> None:
        self.settings = settings
        self.sample = 0
        self.clock_scale = 1.0
        """Length of a sample against what `TM` states; other than 1 only by a fault."""
        self._trace = trace
        self._epoch_s = 0.0
        self._epoch_sample = 0
        self._time_setting = 1000.0
        self._burned_parameters: list[dict[str, float]] = []
        self._burned_variables: dict[str, float] = {}
        self.power_up()

    def power_up(self) -> None:
        """Put everything into its state after switching on; the passing of samples goes on."""
        self.axes = [Axis(letter, self.settings, self.sample) for letter in LETTERS[: self.settings.axes]]
        for axis, values in zip(self.axes, self._burned_parameters, strict=False):
            axis.parameters.restore(values)
        self.contour = ContourQueue(self.settings.contour_places)
        self.contour_axes: list[int] = []
        self.outputs = 0
        self.inputs = (1 << INPUTS) - 1 if self.settings.idle_inputs else 0
        self.analog_inputs = [0.0] * ANALOG_INPUTS
        self.analog_outputs = [0.0] * ANALOG_INPUTS
        self.error_code = 0
        self.variables = dict(self._burned_variables)
        self.arrays: dict[str, list[float]] = {}
        self.configuration = [-1.0, -1.0, -1.0, 0.0, 0.0]
        """What `CN` sets."""
        self.analog_kinds = [2.0] * ANALOG_INPUTS
        """What `AQ` sets."""
        self.input_events: set[int] = set()
        """Inputs that went low since the program engine last asked."""
        self._first_sample = self.sample
        self.set_time_setting(1000.0)

    def burn_parameters(self) -> None:
        """Keep the settings of the axes over a restart."""
        self._burned_parameters = [axis.parameters.copied() for axis in self.axes]

    def burn_variables(self) -> None:
        """Keep the variables over a restart."""
        self._burned_variables = dict(self.variables)

    @property
    def programs_outlive_abort(self) -> bool:
        """Whether programs go on when the abort input stops the axes (fifth field of `CN`)."""
        return bool(self.configuration[4])

    @property
    def time(self) -> int:
        """Samples since power-up, which `TIME` reports."""
        return self.sample - self._first_sample

    @property
    def time_setting(self) -> float:
        """Sample period as `TM` states it: nominal microseconds, 1000 for 1/1024 s."""
        return self._time_setting

    @property
    def sample_period_s(self) -> float:
        """Length of a sample in s, as the controller believes it to be."""
        return self._time_setting / (1000.0 * SAMPLES_PER_SECOND)

    def set_time_setting(self, setting: float, clock_scale: float | None = None) -> None:
        """Change the sample period (and by a fault its true length) from the present sample on."""
        self._epoch_s += (self.sample - self._epoch_sample) * self.sample_period_s * self.clock_scale
        self._epoch_sample = self.sample
        self._time_setting = setting
        if clock_scale is not None:
            self.clock_scale = clock_scale
        for axis in self.axes:
            axis.sample_period_s = self.sample_period_s

    def samples_due(self, time_s: float) -> int:
        """Return how many samples have ended at the simulated time `time_s` and not passed yet."""
        period_s = self.sample_period_s * self.clock_scale
        due = self._epoch_sample + math.floor((time_s - self._epoch_s) / period_s + 1e-6)
        return max(0, due - self.sample)

    def advance(self, samples: int) -> int:
        """Let at most `samples` samples pass, up to the first event on an axis; return how many did."""
        quiet = all(axis.quiet for axis in self.axes)
        if not (quiet and (self._trace is None or not self.outputs)):
            samples = min(samples, LARGEST_CHUNK_SAMPLES)
        for axis in self.axes:
            samples = axis.look(samples)
        standing = [(axis.reference_counts, axis.encoder_counts) for axis in self.axes] if self._trace else []
        motions = [axis.take(samples) for axis in self.axes]
        first = self.sample + 1
        self.sample += samples
        if self._trace is not None and (self.outputs or any(motions)):
            rows = _columns(motions, standing, samples)
            self._trace.append(np.arange(first, first + samples), rows[1], rows[0], self.outputs)
        return samples

    def set_output(self, number: int, on: bool) -> None:
        """Switch output `number` (from 1)."""
        bit = 1 << (number - 1)
        self.outputs = self.outputs | bit if on else self.outputs & ~bit

    def output(self, number: int) -> int:
        """State of output `number` (from 1)."""
        return self.outputs >> (number - 1) & 1

    def set_input(self, number: int, level: int) -> None:
        """Drive input `number` (from 1)."""
        bit = 1 << (number - 1)
        if self.inputs & bit and not level:
            self.input_events.add(number)
        self.inputs = self.inputs | bit if level else self.inputs & ~bit

    def input(self, number: int) -> int:
        """Level of input `number` (from 1)."""
        return self.inputs >> (number - 1) & 1


def _columns(
    motions: list[Motion | None], standing: list[tuple[int, int]], samples: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Commanded and encoder counts, (n, axes) each; axes that stood still repeat where they stand."""
    commanded = np.empty((samples, len(motions)), dtype=np.int64)
    encoder = np.empty_like(commanded)
    for column, (motion, (reference, reading)) in enumerate(zip(motions, standing, strict=True)):
        commanded[:, column] = reference if motion is None else np.rint(motion.commanded_counts)
        encoder[:, column] = reading if motion is None else motion.encoder_counts
    return commanded, encoder
