"""What a program must look like in a trace, from the definition of the cubic."""

from __future__ import annotations

import numpy as np

from ibfctl.machine.program import PvtProgram
from ibfctl.runs.trace import RunTrace


def cubic_counts(job: PvtProgram, letter: str) -> np.ndarray:
    """Position at the end of every sample, from the definition of the cubic."""
    axis = job.axes[letter]
    position, velocity = float(axis.start_counts), 0.0
    values = []
    for move, end_velocity, samples in zip(
        axis.increment_counts, axis.end_velocity_counts_s, job.time_samples, strict=True
    ):
        duration = samples * job.sample_period_s
        tau = np.arange(1, samples + 1) * job.sample_period_s
        quadratic = 3 * move / duration**2 - (2 * velocity + end_velocity) / duration
        cubic = (velocity + end_velocity) / duration**2 - 2 * move / duration**3
        values.append(position + velocity * tau + quadratic * tau**2 + cubic * tau**3)
        position, velocity = position + move, float(end_velocity)
    return np.concatenate(values)


def assert_executed_with_the_gate_open(job: PvtProgram, trace: RunTrace) -> None:
    """Every sample of the motion lies on the cubics, in one exposure that begins and ends at rest."""
    exposed = np.flatnonzero(trace.gate_open)
    first, last = exposed[0], exposed[-1]
    assert np.all(trace.gate_open[first : last + 1])
    assert np.all(np.diff(trace.sample[first : last + 1]) == 1)
    analytic = {letter: cubic_counts(job, letter) for letter in "AB"}
    seen = {letter: trace.position_counts[letter][first : last + 1] for letter in "AB"}
    begins = min(
        int(np.flatnonzero(seen[letter] != job.axes[letter].start_counts)[0])
        - int(np.flatnonzero(np.rint(analytic[letter]) != job.axes[letter].start_counts)[0])
        for letter in "AB"
    )
    ends = begins + int(job.time_samples.sum())
    for letter in "AB":
        assert np.max(np.abs(seen[letter][max(begins, 0) : ends] - analytic[letter][max(-begins, 0) :])) <= 0.5 + 1e-6
        assert np.all(seen[letter][: max(begins, 0)] == job.axes[letter].start_counts)
        assert np.all(seen[letter][ends:] == job.axes[letter].end_counts)
