"""One continuous streamed motion, and what became of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from ibfctl.errors import AbortedError, EstoppedError, IbfctlError, StoppedError
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import IntArray, MotionProgram, PvtProgram
from ibfctl.runs import seam
from ibfctl.runs.polls import Polls


@dataclass(frozen=True)
class Leg:
    """A motion from rest to rest, and where it belongs in the plan.

    Attributes
    ----------
    program
        What is streamed.
    open_at
        Segments after which the gate opens; 0 opens it together with the motion.
    first_plan_sample
        Where in the plan that is, in samples from its begin.
    shift_samples
        What to add to a leg's sample to get the plan's, from where a run-in has joined it.
    """

    program: MotionProgram
    open_at: int = 0
    first_plan_sample: int = 0
    shift_samples: int = 0

    @classmethod
    def resumed(cls, plan: PvtProgram, plan_sample: int, machine: MachineDescription) -> Leg:
        """Return the leg that takes a plan up at a seam."""
        way = seam.run_in(plan, plan_sample, machine)
        lead_samples = int(way.program.time_samples[: way.open_at].sum())
        return cls(way.program, way.open_at, way.plan_sample, way.plan_sample - lead_samples)

    @cached_property
    def ends_samples(self) -> IntArray:
        """Samples from the leg's begin to the end of each segment, a zero first."""
        return np.concatenate([[0], np.cumsum(self.program.time_samples)]).astype(np.int64)


class LegEnd(StrEnum):
    """How a leg ended."""

    COMPLETED = "completed"
    PAUSED = "paused"
    STOPPED = "stopped"
    ABORTED = "aborted"
    ESTOPPED = "estopped"
    FAULTED = "faulted"


def end_of(error: BaseException) -> LegEnd:
    """Name the end that an error is."""
    for kind, end in (
        (EstoppedError, LegEnd.ESTOPPED),
        (AbortedError, LegEnd.ABORTED),
        (StoppedError, LegEnd.STOPPED),
    ):
        if isinstance(error, kind):
            return end
    return LegEnd.FAULTED


@dataclass(frozen=True)
class LegOutcome:
    """What became of a leg.

    Attributes
    ----------
    leg
        As it was streamed in the end, with the ramp of a pause.
    end
        How it ended.
    error
        What the run must end with, where it was neither completed nor paused.
    open_plan_samples
        Where in the plan the gate opened and closed; None where it never was open.
    uncertainty_samples
        By how many samples the closing may have been later than stated; 0 where the controller has stamped it.
    sent, executed
        Segments of the leg.
    minimum_margin_s
        Least motion surely left in the buffer while there was more to send, in controller seconds.
    stop_codes, position_error_counts
        By axis letter, at rest; empty where the controller could not be asked.
    begun_samples
        The controller's sample counter at the begin of the motion; 0 where there was none.
    polls
        All that was polled on the way.
    """

    leg: Leg
    end: LegEnd
    error: IbfctlError | None
    open_plan_samples: tuple[int, int] | None
    uncertainty_samples: int
    sent: int
    executed: int
    minimum_margin_s: float
    stop_codes: Mapping[str, int]
    position_error_counts: Mapping[str, int]
    begun_samples: int
    polls: Polls

    @property
    def seam(self) -> int:
        """Where in the plan a resume has to begin, in samples from the plan's begin."""
        return self.leg.first_plan_sample if self.open_plan_samples is None else self.open_plan_samples[1]
