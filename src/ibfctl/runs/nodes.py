"""Motion as nodes, which can be cut and joined where it is not at rest; a program is one that begins at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.machine.program import AxisProgram, IntArray, PvtProgram
from ibfctl.schedule.hermite import Cubics

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Nodes:
    """Absolute integers at the nodes of a motion.

    Attributes
    ----------
    sample : (n + 1,) int64
        Ascending.
    position_counts, velocity_counts_s : mapping of axis letter to (n + 1,) int64
    """

    sample: IntArray
    position_counts: Mapping[str, IntArray]
    velocity_counts_s: Mapping[str, IntArray]

    @classmethod
    def of(cls, program: PvtProgram) -> Nodes:
        """Nodes of a program, its begin at sample 0 and at rest."""
        positions = {
            letter: axis.start_counts + np.concatenate([[0], np.cumsum(axis.increment_counts)])
            for letter, axis in program.axes.items()
        }
        velocities = {
            letter: np.concatenate([[0], axis.end_velocity_counts_s]) for letter, axis in program.axes.items()
        }
        return cls(np.concatenate([[0], np.cumsum(program.time_samples)]), positions, velocities)

    def __len__(self) -> int:
        """Return the number of segments."""
        return int(self.sample.size - 1)

    def part(self, first: int, last: int) -> Nodes:
        """Segments `first` to `last` (exclusive)."""
        part = slice(first, last + 1)
        return Nodes(
            self.sample[part],
            {letter: values[part] for letter, values in self.position_counts.items()},
            {letter: values[part] for letter, values in self.velocity_counts_s.items()},
        )

    def then(self, other: Nodes) -> Nodes:
        """Join: `other` goes on where and as fast as this ends; its samples are shifted to follow."""
        shifted = other.sample[1:] + (self.sample[-1] - other.sample[0])
        return Nodes(
            np.concatenate([self.sample, shifted]),
            {k: np.concatenate([self.position_counts[k], other.position_counts[k][1:]]) for k in self.position_counts},
            {
                k: np.concatenate([self.velocity_counts_s[k], other.velocity_counts_s[k][1:]])
                for k in self.velocity_counts_s
            },
        )

    def with_node(self, sample: int, sample_period_s: float) -> tuple[Nodes, int]:
        """Add a node on the cubic, to within half a count; return which one it is. An old one is left as it is."""
        segment = int(np.searchsorted(self.sample, sample, side="right")) - 1
        if self.sample[segment] == sample:
            return self, segment
        positions, velocities = self.state_at(np.array([sample], dtype=np.float64), sample_period_s)
        place = segment + 1
        return (
            Nodes(
                np.insert(self.sample, place, sample),
                {k: np.insert(v, place, round(float(positions[k][0]))) for k, v in self.position_counts.items()},
                {k: np.insert(v, place, round(float(velocities[k][0]))) for k, v in self.velocity_counts_s.items()},
            ),
            place,
        )

    def state_at(
        self, sample: FloatArray, sample_period_s: float
    ) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Position in counts and velocity in counts/s by axis at times (m,), fractions of samples included."""
        segment = np.clip(np.searchsorted(self.sample, sample, side="right") - 1, 0, len(self) - 1)
        tau_s = (sample - self.sample[segment]) * sample_period_s
        positions, velocities = {}, {}
        for letter in self.position_counts:
            position, velocity = self.position_counts[letter], self.velocity_counts_s[letter]
            start = position[segment].astype(np.float64)
            cubics = Cubics(
                start,
                position[segment + 1] - start,
                velocity[segment].astype(np.float64),
                velocity[segment + 1].astype(np.float64),
                np.asarray((self.sample[segment + 1] - self.sample[segment]) * sample_period_s, dtype=np.float64),
            )
            positions[letter], velocities[letter] = cubics.position(tau_s), cubics.velocity(tau_s)
        return positions, velocities

    def cubics(self, sample_period_s: float) -> dict[str, Cubics]:
        """Segments of every axis in counts, counts/s and s."""
        time_s = np.diff(self.sample) * sample_period_s
        return {
            letter: Cubics.through(
                position.astype(np.float64), self.velocity_counts_s[letter].astype(np.float64), time_s
            )
            for letter, position in self.position_counts.items()
        }

    def program_like(self, program: PvtProgram) -> PvtProgram:
        """Return the program for the axes of `program`; this motion must begin at rest."""
        axes = {
            letter: AxisProgram(
                np.diff(self.position_counts[letter]),
                self.velocity_counts_s[letter][1:],
                int(self.position_counts[letter][0]),
                axis.counts_per_mm,
            )
            for letter, axis in program.axes.items()
        }
        return replace(program, axes=axes, time_samples=np.diff(self.sample))
