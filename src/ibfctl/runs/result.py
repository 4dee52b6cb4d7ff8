"""What became of a run."""

from __future__ import annotations

from dataclasses import dataclass

from ibfctl.errors import IbfctlError
from ibfctl.runs.as_run import Duration
from ibfctl.runs.checks import PreflightCheck
from ibfctl.runs.leg import LegOutcome
from ibfctl.runs.outcome import RunOutcome
from ibfctl.runs.states import RunState
from ibfctl.runs.trace import RunTrace


@dataclass(frozen=True)
class RunResult:
    """What became of a run.

    Attributes
    ----------
    state
        The state that it ended in.
    error
        Why, where it was not completed.
    checks
        The preflight's list.
    legs
        What became of each leg, in their order.
    trace
        Where the stages were while the gate was open; None where it never was.
    duration
        Planned against as-run duration.
    sample_period_s, wall_s
        The machine's, and the duration of the whole run on the host's clock.
    """

    state: RunState
    error: IbfctlError | None
    checks: tuple[PreflightCheck, ...]
    legs: tuple[LegOutcome, ...]
    trace: RunTrace | None
    duration: Duration
    sample_period_s: float
    wall_s: float

    @property
    def executed_plan_samples(self) -> tuple[tuple[int, int], ...]:
        """Parts of the plan that were executed with the gate open."""
        return tuple(leg.open_plan_samples for leg in self.legs if leg.open_plan_samples is not None)

    @property
    def uncertainty_samples(self) -> int:
        """By how much the end of the last part may be later."""
        return self.legs[-1].uncertainty_samples if self.legs else 0

    def outcome(self) -> RunOutcome:
        """Return the figures of a run file, of all legs together."""
        last = self.legs[-1]
        return RunOutcome(
            segments_sent=sum(leg.sent for leg in self.legs),
            segments_executed=sum(leg.executed for leg in self.legs),
            stop_codes=last.stop_codes,
            final_position_error_counts=last.position_error_counts,
            minimum_buffer_margin_s=min(leg.minimum_margin_s for leg in self.legs),
            duration_s=float(sum(b - a for a, b in self.executed_plan_samples)) * self.sample_period_s,
            wall_s=self.wall_s,
            sample_period_s=self.sample_period_s,
        )
