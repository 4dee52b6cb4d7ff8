"""The planner: joins surface, path, dwell and schedule into a plan that proves itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.deposition import grid_of
from ibfctl.dwell.misfit import cell_size, make_misfit
from ibfctl.dwell.motion import executed_removal
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import Cancelled, DwellProblem, never
from ibfctl.dwell.trade_off import shortest_at_floor
from ibfctl.errors import CancelledError, InputError
from ibfctl.machine.description import MachineDescription
from ibfctl.path.from_file import read_nodes
from ibfctl.path.raster import raster
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.aperture import bounding_box, check_sizes, clear_aperture_mask, grown
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import DwellPlan, InputFile, Plan, Prediction, levelled
from ibfctl.schedule.scheduler import PvtSchedule, schedule, shortest_times
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.levelling import Levelling, rms
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]
Progress = Callable[[str, float], None]

# How much residual, relative to the floor, is given for a shorter run.
MARGIN = 0.01
# Corridor as a share of the pitch, where none is given.
CORRIDOR_SHARE = 0.05


def _silent(stage: str, fraction: float) -> None:
    """Report to nobody."""


def make_plan(
    surface: SurfaceMap,
    influence: InfluenceFunction,
    machine: MachineDescription,
    options: PlanOptions,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    inputs: Mapping[str, InputFile] | None = None,
) -> Plan:
    """Plan the removal of what a map shows with one tool.

    Parameters
    ----------
    surface, influence, machine, options
        What was measured, what the tool removes, the stages, and the user's choices.
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

    stage("reading the clear aperture", 0.0)
    check_sizes(surface, influence)
    mask = clear_aperture_mask(surface, options.clear_aperture)
    path = make_path(surface, mask, influence, options)
    corridor_mm = _corridor_mm(options)
    grid = grid_of(surface)
    levelling = Levelling.over(mask, options.remove)
    target = levelling(surface.height_nm[mask])

    def residual_nm(removal_nm: FloatArray) -> FloatArray:
        return np.asarray(target - levelling(removal_nm[mask]))

    stage("solving dwell times", 0.1)
    misfit = make_misfit(surface, mask, influence, options.remove, cell_size(surface, influence))
    lower_s = np.maximum(shortest_times(path, machine), options.dwell_min_s or 0.0)
    ideal = RemovalOperator(grid, influence, path.dwell_x_mm, path.dwell_y_mm)
    problem = DwellProblem(
        RemovalOperator(misfit.grid, misfit.influence, path.dwell_x_mm, path.dwell_y_mm),
        misfit,
        lower_s,
        np.full(path.segments, np.inf),
    )
    dwell_s = shortest_at_floor(
        problem,
        lambda time_s: rms(residual_nm(ideal(time_s))),
        margin=MARGIN,
        start_s=lower_s,
        cancelled=stop,
    ).chosen.time_s
    stage("scheduling", 0.7)
    scheduled = schedule(path, dwell_s, machine, corridor_mm, stretch=True)
    stage("predicting the executed removal", 0.9)
    removal_nm = executed_removal(scheduled.program, grid, influence)
    prediction = Prediction(
        mask,
        levelled(surface.height_nm, mask, levelling),
        _over(mask, residual_nm(ideal(dwell_s))),
        removal_nm,
        _over(mask, residual_nm(removal_nm)),
    )
    report("planned", 1.0)
    return Plan(
        machine,
        options,
        path,
        DwellPlan(path.dwell_x_mm, path.dwell_y_mm, dwell_s),
        scheduled.program,
        scheduled.certificate,
        surface,
        influence,
        prediction,
        dict(inputs or {}),
        time.perf_counter() - begin,
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
    scheduled: PvtSchedule = schedule(path, dwell_s[1:], machine, _corridor_mm(options))
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


def make_path(
    surface: SurfaceMap, mask: NDArray[np.bool_], influence: InfluenceFunction, options: PlanOptions
) -> ToolPath:
    """Make the path that the options ask for: the clear aperture and an overrun by the tool's radius."""
    if isinstance(options.path, Path):
        return read_nodes(options.path)
    area = grown(bounding_box(surface, mask), influence.radius_mm)
    return raster(area, options.pitch_mm, options.step_mm, options.scan_axis)


def _corridor_mm(options: PlanOptions) -> float:
    corridor_mm = CORRIDOR_SHARE * options.pitch_mm if options.corridor_mm is None else options.corridor_mm
    if not (np.isfinite(corridor_mm) and corridor_mm > 0):
        raise InputError(f"corridor is {corridor_mm:g} mm, it must be positive", "correct --corridor-mm")
    return corridor_mm


def _over(mask: NDArray[np.bool_], values: FloatArray) -> FloatArray:
    result = np.full(mask.shape, np.nan)
    result[mask] = values
    return result
