"""The tools of a plan one by one: a plan file for each run, and the later tools anew after the runs of the earlier."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ibfctl.errors import InputError
from ibfctl.jobs.plan_files import hashed
from ibfctl.planning.file import read_plans, read_sequence, write_plan, write_sequence
from ibfctl.planning.sequence import PlanSequence
from ibfctl.planning.several import replan_later
from ibfctl.runs.run_file import completed_one_tool, read_as_run


def beside(path: Path, mark: str) -> Path:
    """Return the path of a file beside another, with a mark before its suffix."""
    return path.with_name(f"{path.stem}{mark}{path.suffix}")


def split_file(plan_file: Path) -> list[Path]:
    """Write the plan of every tool as an ordinary plan file, `.tool<n>` before its suffix; return them in order.

    Raises
    ------
    InputError
        If the file is no plan, or one cannot be written.
    """
    written = []
    for number, plan in enumerate(read_plans(plan_file), 1):
        written.append(beside(plan_file, f".tool{number}"))
        write_plan(plan, written[-1])
    return written


def replan_tools_file(
    plan_file: Path,
    runs: Sequence[Path],
    output: Path,
    done: int | None = None,
    cancelled: Callable[[], bool] = lambda: False,
) -> PlanSequence:
    """Plan the later tools anew from what the runs of the earlier ones have removed, and write the plan to `output`.

    Parameters
    ----------
    runs
        Run files of the earlier tools: all that have removed anything, an interrupted one and the one of its rest too.
    done
        How many tools have run; by default as many as there are files, which must all be of completed runs then.

    Raises
    ------
    InputError, LimitsError, SolverError, CancelledError
        As `replan_later` does, if a run file shows no removal, or if it is not said how many tools are done where
        that cannot be counted; nothing is written then.
    """
    sequence = read_sequence(plan_file)
    removed_nm = np.zeros(sequence.surface.height_nm.shape)
    inputs = dict(sequence.inputs)
    for number, run in enumerate(runs, 1):
        if done is None and not completed_one_tool(run):
            raise InputError(
                f"run file {run}: not the completed run of one tool",
                "finish that tool first (`ibfctl replan`), then give the files of all runs, and say with --done how "
                "many tools are through",
            )
        as_run = read_as_run(run)
        if as_run is None or as_run.removal_nm.shape != removed_nm.shape:
            raise InputError(f"run file {run}: shows no removal on the map of {plan_file}", "give runs of its tools")
        removed_nm = removed_nm + as_run.removal_nm
        inputs[f"run {number}"] = hashed(run)
    sequence = replace(sequence, inputs=inputs)
    later = replan_later(sequence, len(runs) if done is None else done, removed_nm, cancelled=cancelled)
    write_sequence(later, output)
    return later
