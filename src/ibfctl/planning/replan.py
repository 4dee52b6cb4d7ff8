"""The rest of a plan that was interrupted: what was removed so far, the path from the seam on, a plan for that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.deposition import grid_of
from ibfctl.dwell.motion import PREDICTION_POINTS, points_per_segment
from ibfctl.dwell.operator import removal_of_samples
from ibfctl.dwell.solver import Cancelled
from ibfctl.dwell.trade_off import Aim
from ibfctl.errors import InputError, LimitsError
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.bounds import step_bounds
from ibfctl.planning.job import corridor_of, seen_on_part
from ibfctl.planning.plan import InputFile, Plan
from ibfctl.planning.planner import Progress, make_plan
from ibfctl.planning.restart import places, restart
from ibfctl.planning.target import Target
from ibfctl.surface.levelling import rms

FloatArray = NDArray[np.float64]
Interval = tuple[float, float]

# Share of a step: one of which less is left goes into the one after it; so long is the step to gather speed in.
_STUB = 0.1
# What starting from rest may add to the time that was left.
_RESTART = 1.01
_RESTART_S = 0.5


def removal_of_intervals(plan: Plan, intervals: Sequence[Interval]) -> FloatArray:
    """Removal (ny, nx) in nm of the cubics of a plan, executed with the gate open in parts alone.

    Parameters
    ----------
    plan
        With a map and an influence function.
    intervals
        When the gate was open, in samples since the begin of the program.

    Raises
    ------
    InputError
        If the plan is a mere schedule.
    """
    if plan.surface is None or plan.influence is None:
        raise InputError("removal: the plan holds no map", "make it with `ibfctl plan`, not `ibfctl schedule`")
    program, influence = plan.program, seen_on_part(plan.influence, plan.options.placement)
    node, weight = np.polynomial.legendre.leggauss(max(PREDICTION_POINTS, points_per_segment(program, influence)))
    ends = np.cumsum(program.time_samples)
    x_mm: list[FloatArray] = []
    y_mm: list[FloatArray] = []
    time_s: list[FloatArray] = []
    for first, last in intervals:
        begin = np.clip(first - ends + program.time_samples, 0, program.time_samples)
        end = np.clip(last - ends + program.time_samples, 0, program.time_samples)
        (segment,) = np.nonzero(end > begin)
        width_s = (end - begin)[segment, None] * program.sample_period_s
        tau_s = begin[segment, None] * program.sample_period_s + 0.5 * (node + 1) * width_s
        begun = np.repeat(ends[segment] - program.time_samples[segment], node.size)
        found = places(program, begun + tau_s.ravel() / program.sample_period_s)
        for coordinate, places_mm in (("x", x_mm), ("y", y_mm)):
            axis = program.axis_of(coordinate)
            places_mm.append(found[program.coordinates[coordinate]][0] / axis.counts_per_mm)
        time_s.append((0.5 * weight * width_s).ravel())
    if not sum(part.size for part in time_s):
        return np.zeros(plan.surface.height_nm.shape)
    grid = grid_of(plan.surface)
    place_mm = plan.options.placement.inverse(np.concatenate(x_mm), np.concatenate(y_mm))
    return removal_of_samples(grid, influence, *place_mm, np.concatenate(time_s))


def replan(
    plan: Plan,
    removal_nm: FloatArray,
    seam: float,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    inputs: Mapping[str, InputFile] | None = None,
) -> Plan:
    """Plan what an interrupted run has left: the rest of its path, for what its map still shows.

    Parameters
    ----------
    plan
        What was run, made for one tool.
    removal_nm : (ny, nx) float64
        Removed so far.
    seam
        Where the run ended, in samples since the begin of its program.
    progress, cancelled, inputs
        As in `make_plan`.

    Returns
    -------
    Plan
        Its map is what is left of the first plan's, so its residual is that of the finished part.

    Raises
    ------
    InputError, LimitsError, SolverError, CancelledError
        As `make_plan`; and if nothing is left, or the plan is a mere schedule.
    """
    if plan.surface is None or plan.influence is None or plan.prediction is None:
        raise InputError("re-planning: the plan holds no map", "make it with `ibfctl plan`, not `ibfctl schedule`")
    surface = replace(plan.surface, height_nm=_wanted_nm(plan) - removal_nm)
    path, planned = restart(plan, seam, corridor_of(plan.options))
    aim = _aim(plan, seam, path)
    # Corners that were rounded stay so: their blocks are in the path that is left.
    options = replace(plan.options, path="nodes", l_curve=False, trade_off=False, aim=aim, corner_tolerance_mm=None)
    if options.extra_removal_nm is not None:
        # The depth is in the map now: it must not go a second time.
        options = replace(options, remove="none", extra_removal_nm=None)
    mask = plan.prediction.clear_aperture
    make = partial(
        make_plan,
        surface,
        plan.influence,
        plan.machine,
        path=path,
        planned=planned,
        promised_nm=rms(plan.prediction.executed_residual_nm[mask]),
        mask=mask,
        progress=progress,
        cancelled=cancelled,
        inputs=inputs,
    )
    try:
        return make(options)
    except LimitsError:
        if aim.max_residual_nm is None:
            raise
        # That is out of reach for the rest alone: then as near to it as can be.
        return make(replace(options, aim=Aim()))


def _wanted_nm(plan: Plan) -> FloatArray:
    """Return what was to go from every pixel (ny, nx): the map, and the depth beside it where there is one."""
    assert plan.surface is not None
    assert plan.influence is not None
    assert plan.prediction is not None
    if plan.options.extra_removal_nm is None:
        return plan.surface.height_nm
    mask, influence = plan.prediction.clear_aperture, seen_on_part(plan.influence, plan.options.placement)
    wanted_nm = plan.surface.height_nm.copy()
    wanted_nm[mask] = Target.of(plan.surface, influence, mask, plan.options).wanted_nm
    return wanted_nm


def _aim(plan: Plan, seam: float, path: ToolPath) -> Aim:
    """Return what the rest is to aim at: what the whole did."""
    aim = plan.options.aim
    if aim.max_time_s is not None:
        left_s = plan.program.total_time_s - seam * plan.program.sample_period_s
        stage_path = ToolPath(*plan.options.placement(path.x_mm, path.y_mm))
        shortest_s = float(step_bounds(stage_path, plan.machine, plan.options).lower_s.sum())
        return replace(aim, max_time_s=max(_RESTART * left_s + _RESTART_S, shortest_s))
    if aim.max_residual_nm is not None and plan.prediction is not None:
        mask = plan.prediction.clear_aperture
        return replace(aim, max_residual_nm=max(aim.max_residual_nm, rms(plan.prediction.executed_residual_nm[mask])))
    return aim
