"""Schedulers side by side on the same paths and dwell times, judged by the motion that each would execute.

The comparison of Wang et al. 2023, J. Manuf. Process. 88, Figs. 5 and 6, in figures. Baselines are never sent to a
machine: they end here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.methods.nnls import nnls_then_limits
from ibfctl.dwell.operator import RemovalOperator, removal_of_samples
from ibfctl.dwell.solver import Cancelled, Regularisation, never
from ibfctl.errors import CancelledError
from ibfctl.machine.description import MachineDescription
from ibfctl.path.figures import PathFigures, path_figures
from ibfctl.planning.aperture import pixels_of
from ibfctl.planning.corners import gentlest, sharp_job
from ibfctl.planning.job import PlanningJob, prepare
from ibfctl.planning.loop import execute, refine
from ibfctl.planning.options import MadePath, PlanOptions
from ibfctl.planning.planner import Progress, solve_dwell
from ibfctl.schedule.baselines.constant_acceleration import constant_acceleration
from ibfctl.schedule.baselines.motion import Motion, motion_of_schedule
from ibfctl.schedule.baselines.position_mode import position_mode
from ibfctl.schedule.scheduler import PvtSchedule, schedule, with_jerk_limit
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class SchedulerFigures:
    """What one scheduler makes of a path and its dwell times.

    Attributes
    ----------
    overshoot_mm
        How far an axis leaves the range between the two ends of the segment that it is on.
    excursion_mm
        Largest distance from the segment that the motion is on. Position mode is measured against the straight
        lines between dwell points, which it walks; of rounded corners it is a bound on the distance from the
        programmed path.
    largest_acceleration_jump_mm_s2, rms_acceleration_jump_mm_s2
        Jumps of the acceleration; the second is the root of the sum of their squares over the number of segments.
    peak_acceleration_mm_s2, peak_jerk_mm_s3
        By coordinate; the jerk where the acceleration does not jump.
    total_time_s
        Run time.
    executed_rms_nm
        Residual after the motion.
    """

    overshoot_mm: float
    excursion_mm: float
    largest_acceleration_jump_mm_s2: float
    rms_acceleration_jump_mm_s2: float
    peak_acceleration_mm_s2: Mapping[str, float]
    peak_jerk_mm_s3: Mapping[str, float]
    total_time_s: float
    executed_rms_nm: float


@dataclass(frozen=True)
class ComparedPath:
    """One path: what it covers, what dwell points could leave, and what each scheduler leaves."""

    path: PathFigures
    ideal_rms_nm: float
    schedulers: Mapping[str, SchedulerFigures]


def compare(
    surface: SurfaceMap,
    influence: InfluenceFunction,
    machine: MachineDescription,
    paths: Mapping[str, PlanOptions],
    *,
    jerk_max_mm_s3: float | None = None,
    progress: Progress | None = None,
    cancelled: Cancelled = never,
) -> dict[str, ComparedPath]:
    """Compare the schedulers on each of `paths`, by the name of the path.

    Parameters
    ----------
    surface, influence, machine
        As for a plan.
    paths
        Options by name, as of `path_choices`.
    jerk_max_mm_s3
        Compare also a PVT schedule with this limit of the jerk.

    Raises
    ------
    InputError, LimitsError, SolverError, CancelledError
        As `make_plan` does.
    """
    compared = {}
    for index, (name, options) in enumerate(paths.items()):
        if progress is not None:
            progress(f"comparing on {name}", index / len(paths))
        compared[name] = compare_on(prepare(surface, influence, machine, options), jerk_max_mm_s3, cancelled)
    if progress is not None:
        progress("compared", 1.0)
    return compared


def path_choices(kinds: tuple[MadePath, ...], options: PlanOptions) -> dict[str, PlanOptions]:
    """Options by name for kinds of path; "raster" is one along x and one along y."""
    choices = {}
    for kind in kinds:
        if kind == "raster":
            choices["raster x"] = replace(options, path="raster", scan_axis="x")
            choices["raster y"] = replace(options, path="raster", scan_axis="y")
        else:
            choices[kind] = replace(options, path=kind)
    return choices


def compare_on(job: PlanningJob, jerk_max_mm_s3: float | None = None, cancelled: Cancelled = never) -> ComparedPath:
    """Compare the schedulers on the path of a job: all get the times that the plain chain's program takes.

    But for one row: PVT with the times of the classic chain, non-negative least squares first, limits afterwards. A job
    with rounded corners has rows for them beside those for the sharp path.
    """
    operator = RemovalOperator(job.grid, job.influence, job.path.dwell_x_mm, job.path.dwell_y_mm)
    regularisation = Regularisation(job.options.tikhonov)
    chosen = solve_dwell(job, operator, regularisation, cancelled).chosen
    sharp = sharp_job(job)
    plain = execute(sharp, chosen.time_s)
    dwell_s = plain.scheduled.segment_time_s

    def rows() -> Iterator[tuple[str, SchedulerFigures]]:
        yield "pvt", _of_schedule(sharp, plain.scheduled)
        if jerk_max_mm_s3 is not None:
            limited = schedule(
                job.stage_path, dwell_s, job.machine, sharp.corridor_mm, stretch=True, jerk_max_mm_s3=jerk_max_mm_s3
            )
            yield "pvt, jerk limited", _of_schedule(sharp, limited)
        classic = nnls_then_limits(job.ideal_problem(job.misfit), cancelled=cancelled)
        yield (
            "pvt, classic dwell times",
            _of_schedule(sharp, schedule(job.stage_path, classic.time_s, job.machine, sharp.corridor_mm, stretch=True)),
        )
        best, _ = refine(sharp, plain, chosen.price_nm2_s, regularisation, cancelled)
        yield "pvt, motion in the loop", _of_schedule(sharp, best.scheduled)
        if job.rounded is not None:
            gentle, found = gentlest(job, plain, dwell_s, cancelled)
            yield "rounded", _of_schedule(gentle, found.scheduled)
            if jerk_max_mm_s3 is not None:
                stages = with_jerk_limit(job.machine, jerk_max_mm_s3)
                limited = job.rounded.balanced(dwell_s, stages).schedule(dwell_s, stages)
                yield "rounded, jerk limited", _of_schedule(gentle, limited)
            run_time_s = best.scheduled.program.total_time_s
            smooth, _ = refine(gentle, found, chosen.price_nm2_s, regularisation, cancelled, run_time_s)
            yield "rounded, in the loop", _of_schedule(gentle, smooth.scheduled)
        yield "constant acceleration", _figures(job, constant_acceleration(job.stage_path, dwell_s, job.machine))
        yield "position mode", _figures(job, position_mode(job.stage_path, dwell_s, job.machine))

    figures = {}
    for name, row in rows():
        if cancelled():
            raise CancelledError("the comparison was cancelled", "start it again when wanted")
        figures[name] = row
    gap = path_figures(job.path, pixels_of(job.surface, job.target.clear_aperture))
    return ComparedPath(gap, job.rms_nm(operator(chosen.time_s)), figures)


def summary(compared: Mapping[str, ComparedPath]) -> dict[str, object]:
    """Return the JSON form that `ibfctl compare --json` prints."""
    return {"paths": {name: asdict(figures) for name, figures in compared.items()}}


def _of_schedule(job: PlanningJob, scheduled: PvtSchedule) -> SchedulerFigures:
    if job.rounded is None:
        return _figures(job, motion_of_schedule(scheduled))
    # Along the pieces of the rounded path, but judged against the programmed one.
    pieces = np.arange(len(scheduled.program))
    figures = _figures(job, motion_of_schedule(replace(scheduled, source_segment=pieces)))
    jumps = figures.rms_acceleration_jump_mm_s2 * np.sqrt(pieces.size / job.path.segments)
    deviation_mm = scheduled.certificate["deviation_mm"].value
    return replace(figures, excursion_mm=deviation_mm, rms_acceleration_jump_mm_s2=float(jumps))


def _figures(job: PlanningJob, motion: Motion) -> SchedulerFigures:
    x_mm, y_mm, time_s, _ = motion.samples()
    place_mm = job.options.placement.inverse(x_mm, y_mm)
    return SchedulerFigures(
        motion.overshoot_mm,
        motion.excursion_mm,
        motion.largest_acceleration_jump_mm_s2,
        motion.rms_acceleration_jump_mm_s2,
        motion.peak_acceleration_mm_s2,
        {"x": float(np.abs(motion.x.jerk_mm_s3).max()), "y": float(np.abs(motion.y.jerk_mm_s3).max())},
        motion.total_time_s,
        job.rms_nm(removal_of_samples(job.grid, job.influence, *place_mm, time_s)),
    )
