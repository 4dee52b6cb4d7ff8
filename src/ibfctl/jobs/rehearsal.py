"""A rehearsal: a plan streamed over TCP to an emulated controller, and what that controller really did."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ibfctl.errors import ControllerError, RunError
from ibfctl.planning.as_run import AsRun
from ibfctl.planning.plan import InputFile, Plan
from ibfctl.runs.drivers import connect
from ibfctl.runs.emulator import emulated_controller
from ibfctl.runs.outcome import RunOutcome, RunProgress
from ibfctl.runs.records import as_run_of
from ibfctl.runs.run_file import RunRecord, write_run
from ibfctl.runs.streamer import execute
from ibfctl.runs.trace import read_emulator_trace

Report = Callable[[str, float], None]

# How much slower the clock runs each time that this computer was too busy to keep up with it.
SLOWER = 0.25


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
        Controller seconds per second of the host; a run that a busy host cannot feed at that speed is repeated at a
        quarter of it, down to real time.
    on_progress
        Called with a stage's name and its fraction, 0 to 1.

    Raises
    ------
    RunError, ControllerError
        If the run does not end as planned; nothing is written then.
    """
    with tempfile.TemporaryDirectory(prefix="ibfctl-") as folder:
        trace = Path(folder) / "trace.h5"
        outcome = _streamed(plan, trace, speed, on_progress)
        on_progress("as-run residual", 0.0)
        rehearsal = _recorded(plan, plan_file, outcome, trace, output)
    on_progress("as-run residual", 1.0)
    return rehearsal


def _streamed(plan: Plan, trace: Path, speed: float, on_progress: Report) -> RunOutcome:
    """Run the plan on an emulated controller, with a clock that this computer can keep up with."""

    def tell(progress: RunProgress) -> None:
        on_progress("streaming", progress.executed / progress.total)

    while True:
        on_progress(f"streaming at {speed:g} times real time", 0.0)
        try:
            with emulated_controller(trace, speed=speed) as emulated:
                machine = emulated.in_place_of(plan.machine)
                controller = connect(machine)
                try:
                    return execute(plan.program, machine, controller, on_progress=tell, time_scale=speed)
                finally:
                    controller.close()
        except (RunError, ControllerError):
            if speed <= 1:
                raise
            speed = max(SLOWER * speed, 1.0)


def _recorded(plan: Plan, plan_file: InputFile, outcome: RunOutcome, trace_path: Path, output: Path) -> Rehearsal:
    """Find what an emulated controller's trace removed, and write the run file."""
    trace = read_emulator_trace(trace_path, plan.machine)
    rehearsal = Rehearsal(outcome, as_run_of(plan, trace))
    executed = ((0, int(plan.program.time_samples.sum())),)
    told = RunRecord(plan.machine, executed, trace=trace, outcome=outcome)
    write_run(output, plan, plan_file, told, rehearsal.as_run)
    return rehearsal
