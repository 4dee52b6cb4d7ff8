"""What the encoder reads while the axis follows its command: ideal, lagging, or a second-order servo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ibfctl_simulator.galil.profiles import FloatArray

NOISE_BLOCK_SAMPLES = 1024
FULL_TORQUE_VOLTS = 9.9982
SETTLED_COUNTS = 1e-3
SETTLED_COUNTS_S = 1.0


@dataclass(frozen=True)
class ServoModel:
    """How an axis follows; the default follows perfectly.

    Attributes
    ----------
    kind
        `ideal`; `lag`, a first-order lag of `time_constant_s`; `second_order`, a mass under position and
        velocity feedback with `natural_frequency_hz` and `damping`.
    velocity_feedforward
        Whether the damping of the second-order servo acts on the velocity error alone, so that
        nothing lags at constant speed.
    acceleration_limit_counts_s2
        Acceleration at full torque (`TL` 9.9982); None for no limit. Second order only.
    encoder_resolution_counts
        The encoder reads multiples of this.
    encoder_noise_counts
        Standard deviation of the reading's noise.
    seed
        Makes the noise the same every time.
    """

    kind: Literal["ideal", "lag", "second_order"] = "ideal"
    time_constant_s: float = 0.005
    natural_frequency_hz: float = 30.0
    damping: float = 0.7
    velocity_feedforward: bool = True
    acceleration_limit_counts_s2: float | None = None
    encoder_resolution_counts: int = 1
    encoder_noise_counts: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.kind not in ("ideal", "lag", "second_order"):
            raise ValueError(f"servo.kind: {self.kind!r} is neither 'ideal', 'lag' nor 'second_order'")
        if self.encoder_resolution_counts < 1 or self.encoder_noise_counts < 0 or self.time_constant_s < 0:
            raise ValueError("servo: resolution must be at least 1 count, noise and time constant not negative")


class Servo:
    """The state of one axis's load: position in counts, velocity in counts/s."""

    def __init__(self, model: ServoModel) -> None:
        self.model = model
        self.position_counts = 0.0
        self.velocity_counts_s = 0.0
        self.torque_volts = 0.0
        self.torque_limit_volts = FULL_TORQUE_VOLTS
        self.frozen_counts: int | None = None
        self.disturbance_counts = 0
        """By how much a fault makes the encoder read too little."""
        self._track: list[tuple[float, float, float]] = []

    @property
    def ideal(self) -> bool:
        """Whether the load is always where the command is."""
        return self.model.kind == "ideal"

    @property
    def faithful(self) -> bool:
        """Whether the encoder always reads the load's position, and that is the commanded one."""
        healthy = self.frozen_counts is None and not self.disturbance_counts
        exact = self.model.encoder_resolution_counts == 1 and not self.model.encoder_noise_counts
        return self.ideal and healthy and exact

    def place(self, position_counts: float) -> None:
        """Put the load at rest at a position."""
        self.position_counts = position_counts
        self.velocity_counts_s = self.torque_volts = 0.0

    def settled(self, commanded_counts: float) -> bool:
        """Whether the load stands where it is told to."""
        return self.ideal or _at_rest(commanded_counts, self.position_counts, self.velocity_counts_s)

    def first_settled(self, commanded_counts: float) -> int | None:
        """Index of the first of the samples `look` has shown at which the load stands still; None if none."""
        for index, (position, velocity, _) in enumerate(self._track):
            if _at_rest(commanded_counts, position, velocity):
                return index
        return None

    def look(self, commanded_counts: FloatArray, previous_counts: float, period_s: float) -> FloatArray:
        """Load positions that result from coming commanded positions; nothing is consumed."""
        if self.ideal:
            return commanded_counts
        step = self._lag if self.model.kind == "lag" else self._second_order
        state = (self.position_counts, self.velocity_counts_s, self.torque_volts)
        self._track = []
        for commanded in commanded_counts.tolist():
            state = step(state, previous_counts, commanded, period_s)
            previous_counts = commanded
            self._track.append(state)
        return np.array([position for position, _, _ in self._track])

    def take(self, samples: int, commanded_counts: FloatArray) -> None:
        """Go to the state after the first `samples` samples that `look` has shown."""
        if not samples:
            return
        if self.ideal:
            self.position_counts = float(commanded_counts[samples - 1])
        else:
            self.position_counts, self.velocity_counts_s, self.torque_volts = self._track[samples - 1]

    def read(self, load_counts: FloatArray, first_sample: int) -> FloatArray:
        """Encoder readings (whole counts) for load positions from absolute sample `first_sample` on."""
        if self.frozen_counts is not None:
            return np.full(len(load_counts), float(self.frozen_counts))
        model = self.model
        if model.encoder_noise_counts:
            load_counts = load_counts + model.encoder_noise_counts * self._noise(first_sample, len(load_counts))
        readings: FloatArray = np.rint(load_counts / model.encoder_resolution_counts)
        return readings * model.encoder_resolution_counts - self.disturbance_counts

    def _lag(
        self, state: tuple[float, float, float], _previous: float, commanded: float, period_s: float
    ) -> tuple[float, float, float]:
        share = period_s / (self.model.time_constant_s + period_s)
        position = state[0] + share * (commanded - state[0])
        return position, (position - state[0]) / period_s, 0.0

    def _second_order(
        self, state: tuple[float, float, float], previous: float, commanded: float, period_s: float
    ) -> tuple[float, float, float]:
        """Act during this sample on the error at the end of the one before, as a sampled servo does."""
        model = self.model
        position, velocity, _ = state
        omega = 2.0 * np.pi * model.natural_frequency_hz
        wanted_speed = (commanded - previous) / period_s if model.velocity_feedforward else 0.0
        acceleration = omega**2 * (previous - position)
        acceleration += 2.0 * model.damping * omega * (wanted_speed - velocity)
        torque = 0.0
        if model.acceleration_limit_counts_s2 is not None:
            full = model.acceleration_limit_counts_s2
            limit = full * self.torque_limit_volts / FULL_TORQUE_VOLTS
            acceleration = min(max(acceleration, -limit), limit)
            torque = acceleration / full * FULL_TORQUE_VOLTS
        velocity += acceleration * period_s
        return position + velocity * period_s, velocity, torque

    def _noise(self, first_sample: int, samples: int) -> FloatArray:
        """Normal noise that depends on the absolute sample alone, however time is cut."""
        first = first_sample // NOISE_BLOCK_SAMPLES
        last = (first_sample + samples - 1) // NOISE_BLOCK_SAMPLES
        blocks = [
            np.random.default_rng([self.model.seed, block]).standard_normal(NOISE_BLOCK_SAMPLES)
            for block in range(first, last + 1)
        ]
        start = first_sample - first * NOISE_BLOCK_SAMPLES
        return np.concatenate(blocks)[start : start + samples]


def _at_rest(commanded_counts: float, position_counts: float, velocity_counts_s: float) -> bool:
    near = abs(commanded_counts - position_counts) < SETTLED_COUNTS
    return near and abs(velocity_counts_s) < SETTLED_COUNTS_S
