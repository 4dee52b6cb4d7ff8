"""The as-run trace from what the controller said: its stamps of the gate, and its encoders at every poll."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.machine.program import IntArray, PvtProgram
from ibfctl.runs.leg import LegOutcome
from ibfctl.runs.nodes import Nodes
from ibfctl.runs.trace import RunTrace

FloatArray = NDArray[np.float64]

BLOCK_SAMPLES = 1 << 18
"""A day has 88 million samples: what is computed on the way to their positions is never there for all of them."""


@dataclass(frozen=True)
class Duration:
    """Planned against as-run duration of the motion; a time base that is wrong shows as their difference.

    Attributes
    ----------
    planned_s
        What the controller's samples between first and last poll should take.
    as_run_s
        What they took on the host's clock, in controller seconds.
    resolution_s
        How well the host can tell: half of a usual round trip on either end.
    """

    planned_s: float
    as_run_s: float
    resolution_s: float


def trace_of(outcomes: Sequence[LegOutcome], sample_period_s: float) -> RunTrace:
    """Return where the stages were at every sample at which the gate was open.

    Between polls an encoder's deviation from the program is taken to change linearly. A position at sample k is that
    at its end, as in a controller's own trace.
    """
    samples: list[IntArray] = [np.empty(0, dtype=np.int64)]
    positions: dict[str, list[IntArray]] = {}
    for outcome in outcomes:
        if outcome.open_plan_samples is None:
            continue
        opened, closed = (sample - outcome.leg.shift_samples for sample in outcome.open_plan_samples)
        leg_sample = np.arange(opened + 1, closed + 1)
        for part in np.array_split(leg_sample, max(leg_sample.size // BLOCK_SAMPLES, 1)):
            for letter, counts in _positions(outcome, part, sample_period_s).items():
                positions.setdefault(letter, []).append(np.rint(counts).astype(np.int64))
        # The controller counts anew after a restart; a trace ascends all the same.
        last = int(samples[-1][-1]) if samples[-1].size else 0
        samples.append(leg_sample + max(outcome.begun_samples, last - opened))
    sample = np.concatenate(samples)
    return RunTrace(
        sample,
        {letter: np.concatenate(parts) for letter, parts in positions.items()},
        np.ones(sample.shape, dtype=bool),
        sample_period_s,
    )


def _positions(outcome: LegOutcome, leg_sample: IntArray, sample_period_s: float) -> dict[str, FloatArray]:
    program = outcome.leg.program
    assert isinstance(program, PvtProgram)  # nothing else has a plan
    nodes, polls = Nodes.of(program), outcome.polls
    polled_at = np.clip(polls.time_samples - outcome.begun_samples, 0, nodes.sample[-1]).astype(np.float64)
    commanded, _ = nodes.state_at(polled_at, sample_period_s)
    wanted, _ = nodes.state_at(leg_sample.astype(np.float64), sample_period_s)
    if not polled_at.size:
        return wanted
    return {
        letter: wanted[letter] + np.interp(leg_sample, polled_at, polls.position_counts[letter] - commanded[letter])
        for letter in wanted
    }


def duration_of(outcomes: Sequence[LegOutcome], sample_period_s: float, time_scale: float) -> Duration:
    """Compare the samples that the controller counted with the host's clock."""
    planned_s = as_run_s = resolution_s = 0.0
    for outcome in outcomes:
        polls = outcome.polls
        if polls.time_samples.size < 2:
            continue
        planned_s += float(polls.time_samples[-1] - polls.time_samples[0]) * sample_period_s
        as_run_s += float(polls.host_s[-1] - polls.host_s[0]) * time_scale
        resolution_s += polls.round_trip_s * time_scale
    return Duration(planned_s, as_run_s, resolution_s)
