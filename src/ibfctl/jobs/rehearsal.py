"""A rehearsal: a plan streamed over TCP to an emulated controller, and what that controller really did."""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ibfctl.planning.as_run import AsRun
from ibfctl.planning.plan import InputFile, Plan
from ibfctl.runs.child_worker import run_program
from ibfctl.runs.outcome import RunOutcome
from ibfctl.runs.records import as_run_of
from ibfctl.runs.run_file import RunRecord, write_run
from ibfctl.runs.trace import read_emulator_trace

Report = Callable[[str, float], None]


@dataclass(frozen=True)
class Rehearsal:
    """What a rehearsal proves.

    Attributes
    ----------
    outcome
        The streamer's proof that all was executed.
    as_run
        What the emulated controller's trace removed; None where the plan has no map (scheduling alone).
    """

    outcome: RunOutcome
    as_run: AsRun | None

    def summary(self) -> dict[str, Any]:
        """Return the figures of `ibfctl simulate --json`."""
        return {
            "as_run_rms_nm": self.as_run.rms_nm if self.as_run else None,
            "as_run_pv_nm": self.as_run.pv_nm if self.as_run else None,
            "max_difference_nm": self.as_run.max_difference_nm if self.as_run else None,
            "rms_difference_nm": self.as_run.rms_difference_nm if self.as_run else None,
            "segments_executed": self.outcome.segments_executed,
            "final_position_error_counts": dict(self.outcome.final_position_error_counts),
            "minimum_buffer_margin_s": self.outcome.minimum_buffer_margin_s,
            "stop_codes": dict(self.outcome.stop_codes),
        }


def rehearse(
    plan: Plan,
    output: Path,
    *,
    plan_file: InputFile,
    speed: float = 100.0,
    on_progress: Report = lambda stage, fraction: None,
) -> Rehearsal:
    """Stream a plan to an emulated controller, find what its trace removed, and write the run file.

    Parameters
    ----------
    plan
        What to run.
    output
        Run file to write.
    plan_file
        Name and hash of the plan's file, for the record.
    speed
        Controller seconds per second of the host.
    on_progress
        Called with a stage's name and its fraction, 0 to 1.

    Raises
    ------
    RunError, ControllerError
        If the run does not end as planned; nothing is written then.
    """

    def tell(line: Mapping[str, Any]) -> None:
        on_progress("streaming", line["executed"] / line["total"])

    on_progress("streaming", 0.0)
    with tempfile.TemporaryDirectory(prefix="ibfctl-") as folder:
        trace = Path(folder) / "trace.h5"
        outcome = run_program(plan.program, plan.machine, tell, threading.Event(), trace=trace, speed=speed)
        on_progress("as-run residual", 0.0)
        rehearsal = record(plan, plan_file, outcome, trace, output)
    on_progress("as-run residual", 1.0)
    return rehearsal


def record(plan: Plan, plan_file: InputFile, outcome: RunOutcome, trace_path: Path, output: Path) -> Rehearsal:
    """Find what an emulated controller's trace removed, and write the run file."""
    trace = read_emulator_trace(trace_path, plan.machine)
    rehearsal = Rehearsal(outcome, as_run_of(plan, trace))
    executed = ((0, int(plan.program.time_samples.sum())),)
    told = RunRecord(plan.machine, executed, trace=trace, outcome=outcome)
    write_run(output, plan, plan_file, told, rehearsal.as_run)
    return rehearsal
