"""The run file of a run, from what its worker knows and from what the journal has kept of earlier ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ibfctl.planning.as_run import AsRun, as_run_figures
from ibfctl.planning.plan import Plan
from ibfctl.planning.restart import places
from ibfctl.runs.history import History, history
from ibfctl.runs.job import Job, read_job
from ibfctl.runs.journal import Journal
from ibfctl.runs.places import journal_beside
from ibfctl.runs.result import RunResult
from ibfctl.runs.run_file import RunRecord, read_as_run, write_run
from ibfctl.runs.states import RunState
from ibfctl.runs.tools import Part, part_under_way, plan_input, record_together
from ibfctl.runs.trace import RunTrace


def record_run(folder: Path) -> AsRun | None:
    """Write `run.h5` of the run in `folder` from its journal; return what it, or its last tool, has removed.

    Of a tool that its worker has seen the end of, the file is there already and says more.

    Raises
    ------
    InputError
        If the file cannot be written, or plan, job or journal cannot be read.
    """
    part, job = part_under_way(folder), read_job(folder)
    with Journal.open(journal_beside(folder)) as journal:
        known = history(journal, folder.name)
        event = journal.last(folder.name, "state")
    if not part.is_last and known.seam >= part.total_samples and part.file(folder).is_file():
        record_together(folder, part)
        return read_as_run(part.file(folder))
    told = event.data if event is not None else {}
    record = RunRecord(
        job.machine(folder),
        tuple(known.executed),
        known.uncertainty_samples,
        trace_of_history(part.plan, known),
        state=told.get("state", RunState.QUEUED),
        reason=told.get("reason") or "",
        run=job.run,
        operator=job.operator,
        simulated=job.simulated,
    )
    return _write(folder, part, record)


def record_result(folder: Path, part: Part, job: Job, result: RunResult, before: History) -> AsRun | None:
    """Write the run file of a run, or of a tool, that its worker has seen the end of; return what it has removed.

    Parameters
    ----------
    part
        What was run.
    result
        What the worker has done.
    before
        What earlier workers of the run had done.
    """
    record = RunRecord(
        job.machine(folder),
        (*before.executed, *result.executed_plan_samples),
        result.uncertainty_samples,
        _joined(trace_of_history(part.plan, before), result.trace),
        result.outcome() if result.state is RunState.COMPLETED else None,
        result.state,
        result.error.message if result.error is not None else "",
        job.run,
        job.operator,
        job.simulated,
    )
    return _write(folder, part, record)


def _write(folder: Path, part: Part, record: RunRecord) -> AsRun | None:
    as_run = as_run_of(part.plan, record.trace)
    write_run(part.file(folder), part.plan, plan_input(folder), record, as_run)
    if len(part.plans) > 1:
        record_together(folder, part)
    return as_run


def _joined(first: RunTrace | None, second: RunTrace | None) -> RunTrace | None:
    """One trace after the other; each counts samples from a begin of its own."""
    if first is None or second is None:
        return first or second
    return RunTrace(
        np.append(first.sample, second.sample - second.sample[0] + first.sample[-1] + 1),
        {letter: np.append(counts, second.position_counts[letter]) for letter, counts in first.position_counts.items()},
        np.append(first.gate_open, second.gate_open),
        first.sample_period_s,
    )


def as_run_of(plan: Plan, trace: RunTrace | None) -> AsRun | None:
    """Return what a trace has removed; None where the plan has no map, or the gate was never open."""
    if plan.surface is None or trace is None or not trace.gate_open.any():
        return None
    position_mm = {
        coordinate: trace.position_counts[letter][trace.gate_open] / plan.program.axes[letter].counts_per_mm
        for coordinate, letter in plan.program.coordinates.items()
    }
    return as_run_figures(plan, position_mm["x"], position_mm["y"], trace.sample_period_s)


def trace_of_history(plan: Plan, known: History) -> RunTrace | None:
    """Return where the stages were in the parts that were executed; None where there are none.

    Between the places at which they were seen, what they were off the plan is interpolated.
    """
    if not known.executed:
        return None
    sample = np.concatenate([np.arange(first + 1, last + 1) for first, last in known.executed])
    seen = [place for place in known.places if _within(place[0], known.executed)]
    positions = {}
    for coordinate, column in (("x", 1), ("y", 2)):
        letter = plan.program.coordinates[coordinate]
        axis = plan.program.axes[letter]
        counts = places(plan.program, sample.astype(np.float64))[letter][0]
        if seen:
            at = np.array([place[0] for place in seen], dtype=np.float64)
            off = np.array([place[column] for place in seen]) * axis.counts_per_mm - places(plan.program, at)[letter][0]
            counts = counts + np.interp(sample, at, off)
        positions[letter] = np.rint(counts).astype(np.int64)
    return RunTrace(sample, positions, np.ones(sample.size, dtype=bool), plan.program.sample_period_s)


def _within(sample: int, intervals: Sequence[tuple[int, int]]) -> bool:
    return any(first <= sample <= last for first, last in intervals)
