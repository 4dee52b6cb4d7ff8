"""The planner: joins surface, path, dwell and schedule into a plan that proves itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.aim import Share, TradeOff, TradeOffPoint, ignored
from ibfctl.dwell.curve import walk
from ibfctl.dwell.l_curve import l_curve
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import Cancelled, Regularisation, never
from ibfctl.dwell.trade_off import aim_at
from ibfctl.errors import CancelledError, InputError, LimitsError
from ibfctl.machine.description import MachineDescription
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.corners import compared, gentlest, sharp_job
from ibfctl.planning.job import PlanningJob, corridor_of, prepare
from ibfctl.planning.loop import TIME_SLACK, Executed, execute, executed, refine
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.pairs import corrected_around
from ibfctl.planning.plan import CurvePoint, DwellPlan, InputFile, Plan, Prediction, Round, Smoothing
from ibfctl.schedule.scheduler import PvtSchedule, schedule
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]
Progress = Callable[[str, float], None]


def _silent(stage: str, fraction: float) -> None:
    """Report to nobody."""


def make_plan(
    surface: SurfaceMap,
    influence: InfluenceFunction,
    machine: MachineDescription,
    options: PlanOptions,
    *,
    path: ToolPath | None = None,
    mask: NDArray[np.bool_] | None = None,
    planned: PvtSchedule | None = None,
    promised_nm: float = 0.0,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    inputs: Mapping[str, InputFile] | None = None,
) -> Plan:
    """Plan the removal of what a map shows with one tool.

    Parameters
    ----------
    surface, influence, machine, options
        What was measured, what the tool removes, the stages, and the user's choices.
    path, mask
        A path, and the pixels (ny, nx) of the clear aperture, in place of those that the options ask for.
    planned
        An earlier schedule of `path`, taken up from rest: kept where it leaves less than the one found anew.
    promised_nm
        Residual that an earlier schedule was to leave: while there is more, times around the begin are corrected.
    progress
        Called with the name of a stage and the share of the work done, 0 to 1.
    cancelled
        Asked often; planning ends with `CancelledError` when it answers True.
    inputs
        Names and hashes of the files, kept in the plan.

    Raises
    ------
    InputError, LimitsError, SolverError, CancelledError
        Each with the place and what to do.
    """
    begin = time.perf_counter()
    report, stop = progress or _silent, cancelled or never

    def stage(name: str, fraction: float) -> None:
        if stop():
            raise CancelledError("planning was cancelled", "start it again when wanted")
        report(name, fraction)

    stage("laying the path", 0.0)
    job = prepare(surface, influence, machine, options, path, mask)
    options = job.options
    if options.l_curve:
        stage("finding the Tikhonov factor", 0.1)
        corner = l_curve(job.ideal_problem(job.coarse), job.bounds.lower_s, Regularisation(), cancelled=stop)
        options = replace(options, tikhonov=corner.chosen)
    stage("solving dwell times", 0.1)
    ideal = RemovalOperator(job.grid, job.influence, job.path.dwell_x_mm, job.path.dwell_y_mm)
    regularisation = Regularisation(options.tikhonov)
    solved = solve_dwell(
        job, ideal, regularisation, stop, lambda share: report("solving dwell times", 0.1 + 0.5 * share)
    )
    chosen = solved.chosen
    trade_off: tuple[CurvePoint, ...] = ()
    if options.trade_off:
        stage("walking the curve of residual against time", 0.6)
        chosen, trade_off = _walked(job, ideal, solved, regularisation, stop)
    stage("scheduling", 0.6)

    def corrected(
        job: PlanningJob, plain: Executed, run_time_s: float | None = None
    ) -> tuple[Executed, tuple[Round, ...]]:
        job.check_times(plain.scheduled.segment_time_s)
        if not options.loop:
            return plain, ()
        stage("correcting for the executed motion", 0.7)
        return refine(job, plain, chosen.price_nm2_s, regularisation, stop, run_time_s)

    smoothing: Smoothing | None = None
    if job.rounded is None:
        plain = execute(job, chosen.time_s)
        if planned is not None:
            # The dwell of the ramp would leave a dent where the tool was fast: it is shared out around the seam.
            earlier = executed(job, planned.segment_time_s, planned)
            earlier = corrected_around(job, earlier, 0, promised_nm, stop)
            plain = min(plain, earlier, key=partial(_rank, options))
        best, rounds = corrected(job, plain)
        if planned is not None:
            best = corrected_around(job, best, 0, promised_nm, stop)
    else:
        sharp = sharp_job(job)
        plain = execute(sharp, chosen.time_s)
        reference, _ = corrected(sharp, plain)
        gentle = gentlest(job, plain, chosen.time_s, stop)
        best, rounds = corrected(*gentle, reference.scheduled.program.total_time_s)
        smoothing = compared(job, reference, best)
    report("planned", 1.0)
    return Plan(
        machine,
        options,
        job.path,
        DwellPlan(job.path.dwell_x_mm, job.path.dwell_y_mm, best.asked_s),
        best.scheduled.program,
        best.scheduled.certificate,
        surface,
        influence,
        Prediction(
            job.target.clear_aperture,
            job.target.height_map_nm(),
            job.target.residual_map_nm(ideal(chosen.time_s)),
            best.removal_nm,
            job.target.residual_map_nm(best.removal_nm),
        ),
        rounds,
        dict(inputs or {}),
        time.perf_counter() - begin,
        trade_off,
        smoothing,
    )


def _rank(options: PlanOptions, found: Executed) -> tuple[bool, float]:
    """Order programs by whether they take longer than is allowed, then by what they leave."""
    allowed_s = options.aim.max_time_s
    late = allowed_s is not None and found.scheduled.program.total_time_s > (1 + TIME_SLACK) * allowed_s
    return late, found.rms_nm


def _walked(
    job: PlanningJob, ideal: RemovalOperator, solved: TradeOff, regularisation: Regularisation, cancelled: Cancelled
) -> tuple[TradeOffPoint, tuple[CurvePoint, ...]]:
    """Walk the whole curve; return the point that is chosen on it, and the figures of all."""
    curve = walk(
        job.ideal_problem(job.misfit),
        lambda time_s: job.rms_nm(ideal(time_s)),
        solved,
        regularisation=regularisation,
        cancelled=cancelled,
    )
    figures = (CurvePoint(point.total_time_s, point.rms_nm, point is curve.chosen) for point in curve.points)
    return curve.chosen, tuple(figures)


def solve_dwell(
    job: PlanningJob,
    ideal: RemovalOperator,
    regularisation: Regularisation,
    cancelled: Cancelled = never,
    progress: Share = ignored,
) -> TradeOff:
    """Solve the dwell times of a job at its dwell points, to what its options aim at.

    Raises
    ------
    LimitsError
        If the machine needs more than the time aimed at, or the residual aimed at cannot be reached.
    """
    aim = job.options.aim
    shortest_s, longest_s = job.bounds.lower_s, job.bounds.upper_s
    if aim.max_time_s is not None and shortest_s.sum() > aim.max_time_s:
        raise LimitsError(
            f"plan: this path takes the machine at least {shortest_s.sum():.1f} s, more than {aim.max_time_s:g} s",
            "allow more time, or choose a larger pitch or step",
        )
    nothing_free = not job.target.levelling.basis.size
    if nothing_free and np.isfinite(longest_s).all():
        _check_reach(job, ideal(longest_s))
    found = aim_at(
        job.ideal_problem(job.misfit),
        lambda time_s: job.rms_nm(ideal(time_s)),
        aim,
        start_s=shortest_s,
        coarse=job.ideal_problem(job.coarse),
        regularisation=regularisation,
        cancelled=cancelled,
        progress=progress,
    )
    if aim.max_residual_nm is not None and found.chosen.rms_nm > aim.max_residual_nm * (1 + 1e-6):
        raise LimitsError(
            f"plan: the best residual of this tool and path is about {found.floor.rms_nm:.4g} nm RMS, "
            f"more than the {aim.max_residual_nm:g} nm allowed",
            "allow a larger residual, or choose a smaller pitch or a narrower tool",
        )
    return found


def _check_reach(job: PlanningJob, most_nm: FloatArray) -> None:
    """Refuse a map whose mean height is above what the longest times remove, `most_nm` (ny, nx)."""
    wanted_nm, reached_nm = job.target.wanted_nm.mean(), most_nm[job.target.clear_aperture].mean()
    if wanted_nm > reached_nm:
        raise LimitsError(
            f"plan: {wanted_nm:.4g} nm are to be removed on average, but at {job.options.v_min_mm_s:g} mm/s or more "
            f"this tool and path remove at most {reached_nm:.4g} nm",
            "lower --v-min-mm-s, choose a smaller pitch, or leave piston free with --remove",
        )


def schedule_nodes(
    x_mm: FloatArray,
    y_mm: FloatArray,
    dwell_s: FloatArray,
    machine: MachineDescription,
    corridor_mm: float | None = None,
    inputs: Mapping[str, InputFile] | None = None,
) -> Plan:
    """Schedule nodes whose times come from elsewhere.

    Parameters
    ----------
    x_mm, y_mm, dwell_s : (n,) float64
        Nodes, and the time of the segment that ends at each; the first must be zero.
    corridor_mm
        As in `PlanOptions`; None for 5 % of the median distance between nodes.
    """
    begin = time.perf_counter()
    if dwell_s.shape != x_mm.shape:
        raise InputError(f"schedule: {x_mm.size} nodes but {dwell_s.size} dwell times", "give one dwell time per node")
    if dwell_s.size and dwell_s[0] != 0:
        raise InputError(
            f"schedule: dwell_s of the first node is {dwell_s[0]:g}, it must be 0",
            "each row holds the time of the segment that ends there; put 0 in the first row",
        )
    path = ToolPath(x_mm, y_mm)
    moving = path.length_mm[path.length_mm > 0]
    pitch_mm = float(np.median(moving)) if moving.size else 1.0
    options = PlanOptions(path="nodes", pitch_mm=pitch_mm, step_mm=pitch_mm, corridor_mm=corridor_mm)
    scheduled: PvtSchedule = schedule(path, dwell_s[1:], machine, corridor_of(options))
    return Plan(
        machine,
        options,
        path,
        DwellPlan(path.dwell_x_mm, path.dwell_y_mm, dwell_s[1:]),
        scheduled.program,
        scheduled.certificate,
        inputs=dict(inputs or {}),
        planning_time_s=time.perf_counter() - begin,
    )
