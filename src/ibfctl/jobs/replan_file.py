"""From the run file of an interrupted run to a plan for what is left."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ibfctl.jobs.plan_files import hashed
from ibfctl.planning.file import write_plan
from ibfctl.planning.plan import Plan
from ibfctl.planning.replan import replan
from ibfctl.runs.run_file import Remainder, read_remainder

Report = Callable[[str, float], None]


def replan_file(run: Path, output: Path, on_progress: Report | None = None) -> tuple[Remainder, Plan]:
    """Plan what the run of a run file has left, and write the plan to `output`.

    Returns
    -------
    remainder, plan
        What was left, and the plan for it.

    Raises
    ------
    InputError, LimitsError, SolverError, CancelledError
        As `read_remainder` and `replan`; nothing is written then.
    """
    left = read_remainder(run)
    inputs = {**left.plan.inputs, "run": hashed(run)}
    plan = replan(left.plan, left.removal_nm, left.seam, progress=on_progress, inputs=inputs)
    write_plan(plan, output)
    return left, plan
