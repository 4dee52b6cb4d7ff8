"""A rehearsal of several tools: one run after the other, with a confirmed change of tools between them.

Every tool has a run of its own, with its own run file, so what was done is known between tools as within them. Where
what the earlier tools have removed is not what was predicted, the later ones are planned anew.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ibfctl.errors import InputError
from ibfctl.jobs.rehearsal import Rehearsal, Report, rehearse
from ibfctl.jobs.tool_runs import beside
from ibfctl.planning.advance import Advance
from ibfctl.planning.as_run import AsRun, as_run_together
from ibfctl.planning.file import write_sequence
from ibfctl.planning.plan import InputFile, Plan
from ibfctl.planning.sequence import PlanSequence
from ibfctl.runs.run_file import write_tools_run

Confirm = Callable[[int, Plan], None]


@dataclass(frozen=True)
class ToolRun:
    """The run of one tool.

    Attributes
    ----------
    file
        Its run file.
    rehearsal
        What the run proves.
    replanned
        The plan that it followed instead of the one that it was given; None where it followed that.
    """

    file: Path
    rehearsal: Rehearsal
    replanned: Path | None = None


@dataclass(frozen=True)
class ToolsRehearsal:
    """The runs of all tools, and what they leave together."""

    runs: Sequence[ToolRun]
    as_run: AsRun

    def summary(self) -> dict[str, Any]:
        """Return the figures of `ibfctl simulate --json`: over all tools, and each tool's."""
        each = [run.rehearsal.summary() for run in self.runs]
        return {
            "as_run_rms_nm": self.as_run.rms_nm,
            "as_run_pv_nm": self.as_run.pv_nm,
            "max_difference_nm": self.as_run.max_difference_nm,
            "rms_difference_nm": self.as_run.rms_difference_nm,
            "segments_executed": sum(figures["segments_executed"] for figures in each),
            "final_position_error_counts": _worst([figures["final_position_error_counts"] for figures in each]),
            "minimum_buffer_margin_s": min(figures["minimum_buffer_margin_s"] for figures in each),
            "stop_codes": each[-1]["stop_codes"],
            "tools": [
                figures | {"run": run.file.name, "replanned": run.replanned.name if run.replanned else None}
                for run, figures in zip(self.runs, each, strict=True)
            ],
        }


def rehearse_tools(
    sequence: PlanSequence,
    output: Path,
    *,
    plan_file: InputFile,
    confirm: Confirm,
    speed: float = 100.0,
    on_progress: Report = lambda stage, fraction: None,
) -> ToolsRehearsal:
    """Stream the programs of several tools to emulated controllers in sequence, and write their run files.

    Parameters
    ----------
    sequence
        What to run.
    output
        File for what all leave together; the run file of tool n lies beside it, with `.tool<n>` before the suffix.
    confirm
        Called with the number of the next tool and its plan before every tool but the first: returns when that tool is
        mounted and its machine referenced, and raises to stop.
    plan_file, speed, on_progress
        As for `rehearse`.

    Raises
    ------
    RunError, ControllerError
        If a run does not end as planned; the files of the tools before it are there.
    """
    runs: list[ToolRun] = []
    advance, replanned = Advance.none(sequence), None
    for number in range(1, len(sequence.plans) + 1):
        plan = advance.sequence.plans[number - 1]
        if number > 1:
            confirm(number, plan)
        file = beside(output, f".tool{number}")
        rehearsal = rehearse(plan, file, plan_file=plan_file, speed=speed, on_progress=on_progress)
        if rehearsal.as_run is None:
            raise InputError("rehearsal: a plan of several tools holds no map", "make it with `ibfctl plan --tool`")
        runs.append(ToolRun(file, rehearsal, replanned))
        advance = advance.by(rehearsal.as_run.removal_nm)
        if advance.missed:
            on_progress("planning the later tools anew", 0.0)
            anew, replanned = advance.replanned(), beside(output, f".tool{number + 1}.plan")
            write_sequence(anew, replanned)
            advance = advance.following(anew.plans)
    as_run = as_run_together(sequence, advance.removed_nm)
    tools = [{"run": run.file.name, "replanned": run.replanned.name if run.replanned else None} for run in runs]
    write_tools_run(output, sequence, plan_file, tools, as_run)
    return ToolsRehearsal(runs, as_run)


def _worst(errors_counts: Sequence[Mapping[str, int]]) -> dict[str, int]:
    """Error of the largest size by axis letter."""
    letters = sorted({letter for error in errors_counts for letter in error})
    return {letter: max((error[letter] for error in errors_counts if letter in error), key=abs) for letter in letters}
