"""The planner for several tools: dwell times of all together, then motion, tool after tool."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.misfit import full_width_mm
from ibfctl.dwell.solver import Cancelled, Regularisation, never
from ibfctl.errors import CancelledError, InputError
from ibfctl.planning.job import PlanningJob, prepare
from ibfctl.planning.joint_dwell import JointTimes, ideal_operators, solve_jointly
from ibfctl.planning.loop import Executed, execute, refine
from ibfctl.planning.plan import DwellPlan, InputFile, Plan, Prediction, Round
from ibfctl.planning.planner import Progress
from ibfctl.planning.sequence import Method, PlanSequence
from ibfctl.planning.tool import Tool
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]

# Where the motion leaves more than is asked for, time is so much cheaper in the loop.
CHEAPER = 0.1


def plan_sequence(
    surface: SurfaceMap,
    tools: Sequence[Tool],
    *,
    method: Method = "ours",
    tool_change_s: float = 0.0,
    progress: Progress | None = None,
    cancelled: Cancelled = never,
    inputs: Mapping[str, InputFile] | None = None,
) -> PlanSequence:
    """Plan the removal of what a map shows with several tools.

    Parameters
    ----------
    surface
        What was measured.
    tools
        In any order: they run the widest first.
    method
        See `solve_jointly`. Motion in the loop corrects ours alone, unless the options forbid it.
    tool_change_s
        Time of a change of tools.
    progress, cancelled, inputs
        As for `make_plan`.

    Raises
    ------
    InputError, LimitsError, SolverError, CancelledError
        Each with the place and what to do.
    """
    begin = time.perf_counter()
    if not (np.isfinite(tool_change_s) and tool_change_s >= 0):
        raise InputError(f"tool change takes {tool_change_s:g} s", "give a time of zero or more seconds")

    def stage(name: str, fraction: float) -> None:
        if cancelled():
            raise CancelledError("planning was cancelled", "start it again when wanted")
        if progress is not None:
            progress(name, fraction)

    stage("laying the paths", 0.0)
    tools = sorted(tools, key=lambda tool: full_width_mm(tool.influence), reverse=True)
    jobs = prepare_tools(surface, tools)
    stage("solving dwell times", 0.1)
    solved = solve_jointly(
        jobs,
        method,
        tool_change_s * (len(tools) - 1),
        cancelled,
        lambda share: stage("solving dwell times", 0.1 + 0.5 * share),
    )
    ideal_nm = sum(operator(time_s) for operator, time_s in zip(ideal_operators(jobs), solved.time_s, strict=True))
    executed: list[Executed] = []
    for index, (job, time_s) in enumerate(zip(jobs, solved.time_s, strict=True)):
        stage("scheduling", 0.6 + 0.1 * index / len(jobs))
        executed.append(execute(job, time_s))
        job.check_times(executed[-1].scheduled.segment_time_s)
    rounds: list[Round] = []
    run_time_s = sum(each.scheduled.program.total_time_s for each in executed)
    for index, job in enumerate(jobs):
        stage("correcting for the executed motion", 0.7 + 0.3 * index / len(jobs))
        if method == "ours" and job.options.loop:
            executed[index], found = _corrected(job, index, executed, run_time_s, solved, cancelled)
            rounds += found
    plans = _plans(jobs, tools, executed, solved.time_s)
    first, whole_nm = jobs[0].target, _removal_of(executed)
    stage("planned", 1.0)
    return PlanSequence(
        plans,
        jobs[0].surface,
        Prediction(
            first.clear_aperture,
            first.height_map_nm(),
            first.residual_map_nm(np.asarray(ideal_nm)),
            whole_nm,
            first.residual_map_nm(whole_nm),
        ),
        method,
        tool_change_s,
        tuple(rounds),
        dict(inputs or {}),
        time.perf_counter() - begin,
    )


def replan_later(
    sequence: PlanSequence, done: int, removed_nm: FloatArray, *, cancelled: Cancelled = never
) -> PlanSequence:
    """Plan the tools that are still to run anew, from what the earlier ones have really removed.

    Parameters
    ----------
    done
        How many tools have run.
    removed_nm : (ny, nx)
        What all of them together have removed from the map of the sequence, measured or from their traces.

    Raises
    ------
    InputError
        If no tool is left, or the removal does not fit the map.
    LimitsError, SolverError, CancelledError
        As `plan_sequence` does; a limit on the total time is now what is left of it.
    """
    later = sequence.plans[done:]
    if not (done > 0 and later):
        raise InputError(
            f"replanning: {done} of {len(sequence.plans)} tools have run", "replan between the first tool and the last"
        )
    shape = sequence.surface.height_nm.shape
    aperture = sequence.prediction.clear_aperture
    if removed_nm.shape != shape or not np.isfinite(removed_nm[aperture]).all():
        raise InputError(
            f"replanning: the removal (shape {removed_nm.shape}) does not cover the clear aperture of the map {shape}",
            "give it on the pixels of the map",
        )
    spent_s = sum(plan.program.total_time_s for plan in sequence.plans[:done]) + done * sequence.tool_change_s
    left = replace(sequence.surface, height_nm=sequence.surface.height_nm - np.where(aperture, removed_nm, 0.0))
    return plan_sequence(
        left,
        [_tool_of(plan, spent_s) for plan in later],
        method=sequence.method,
        tool_change_s=sequence.tool_change_s,
        cancelled=cancelled,
        inputs=sequence.inputs,
    )


def _tool_of(plan: Plan, spent_s: float) -> Tool:
    """Return the tool that a plan uses, with what is left of a limit on the total time."""
    if plan.influence is None:
        raise InputError("replanning: a plan holds no influence function", "make it with `ibfctl plan --tool`")
    aim = plan.options.aim
    if aim.max_time_s is not None:
        aim = replace(aim, max_time_s=max(aim.max_time_s - spent_s, 0.0))
    return Tool(plan.influence, plan.machine, replace(plan.options, aim=aim), plan.inputs)


def prepare_tools(surface: SurfaceMap, tools: Sequence[Tool]) -> list[PlanningJob]:
    """Prepare the job of every tool; with an extra removal, for a map of all that is to go, where nothing is free.

    Raises
    ------
    InputError, LimitsError
        As `prepare` does, or if there is no tool.
    """
    if not tools:
        raise InputError("plan: no tool", "give at least one --tool")
    jobs = [prepare(surface, tool.influence, tool.machine, tool.options) for tool in tools]
    last = jobs[-1]
    if last.target.depth_nm is None:
        return jobs
    height_nm = surface.height_nm.copy()
    height_nm[last.target.clear_aperture] = last.target.wanted_nm
    wanted = replace(surface, height_nm=height_nm)
    options = [replace(tool.options, remove="none", extra_removal_nm=None) for tool in tools]
    return [prepare(wanted, tool.influence, tool.machine, choice) for tool, choice in zip(tools, options, strict=True)]


def _removal_of(executed: Sequence[Executed]) -> FloatArray:
    return np.asarray(sum(each.removal_nm for each in executed))


def _corrected(
    job: PlanningJob,
    index: int,
    executed: Sequence[Executed],
    run_time_s: float,
    solved: JointTimes,
    cancelled: Cancelled,
) -> tuple[Executed, list[Round]]:
    """Correct the times of one tool for its motion, on what all others leave as executed of the map and of the time."""
    others = [each for other, each in enumerate(executed) if other != index]
    others_s = sum(each.scheduled.program.total_time_s for each in others)
    alone = job.after(_removal_of(others)) if others else job
    plain = replace(executed[index], rms_nm=alone.rms_nm(executed[index].removal_nm))
    smoothing = solved.smoothing_nm2_s2 / alone.ideal_problem(alone.misfit).curvature()
    regularisation = Regularisation(job.options.tikhonov, smoothing)
    asked_nm = job.options.aim.max_residual_nm
    price_nm2_s = solved.price_nm2_s
    if asked_nm is not None and plain.rms_nm > asked_nm:
        price_nm2_s *= CHEAPER
    best, rounds = refine(alone, plain, price_nm2_s, regularisation, cancelled, run_time_s - others_s)
    return best, [replace(round_, total_time_s=round_.total_time_s + others_s) for round_ in rounds]


def _plans(
    jobs: Sequence[PlanningJob],
    tools: Sequence[Tool],
    executed: Sequence[Executed],
    ideal_s: Sequence[FloatArray],
) -> tuple[Plan, ...]:
    """Make the plan of each tool, on the map that the ones before it are predicted to leave."""
    plans = []
    removed_nm = np.zeros(jobs[0].surface.height_nm.shape)
    for job, tool, motion, time_s, ideal in zip(jobs, tools, executed, ideal_s, ideal_operators(jobs), strict=True):
        here = job.after(removed_nm)
        plans.append(
            Plan(
                job.machine,
                job.options,
                job.path,
                DwellPlan(job.path.dwell_x_mm, job.path.dwell_y_mm, motion.asked_s),
                motion.scheduled.program,
                motion.scheduled.certificate,
                here.surface,
                tool.influence,
                Prediction(
                    here.target.clear_aperture,
                    here.target.height_map_nm(),
                    here.target.residual_map_nm(ideal(time_s)),
                    motion.removal_nm,
                    here.target.residual_map_nm(motion.removal_nm),
                ),
                inputs=tool.inputs,
            )
        )
        removed_nm = removed_nm + motion.removal_nm
    return tuple(plans)
