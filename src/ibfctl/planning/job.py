"""What a plan is made for, checked: the map, its clear aperture, the tool, the path over it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.bounds import DwellBounds
from ibfctl.dwell.deposition import Grid, grid_of
from ibfctl.dwell.misfit import (
    CELLS_PER_WIDTH,
    COARSE_CELLS_PER_WIDTH,
    Misfit,
    cell_size,
    full_width_mm,
    make_misfit,
)
from ibfctl.dwell.operator import Precision, RemovalOperator
from ibfctl.dwell.solver import DwellProblem
from ibfctl.errors import InputError, LimitsError
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.placement import Placement
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.aperture import check_sizes, clear_aperture_mask
from ibfctl.planning.bounds import step_bounds
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.paths import make_path
from ibfctl.planning.rounding import Rounded, rounded
from ibfctl.planning.target import Target
from ibfctl.schedule.scheduler import PvtSchedule, schedule
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.levelling import rms
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]

# Corridor as a share of the pitch, where none is given.
CORRIDOR_SHARE = 0.05


@dataclass(frozen=True)
class PlanningJob:
    """Inputs of one plan and what follows from them directly.

    Attributes
    ----------
    surface, machine, options
        As given.
    influence
        As seen on the part.
    target
        What is to go from the clear aperture.
    misfit, coarse
        The same, averaged over cells, for the solver to finish and to search on.
    path
        Nodes on the part; its overrun included.
    bounds
        Shortest and longest time of each segment.
    corridor_mm
        How far the motion may leave a segment.
    rounded
        The path on the machine with rounded corners; None where they are sharp.
    """

    surface: SurfaceMap
    influence: InfluenceFunction
    machine: MachineDescription
    options: PlanOptions
    target: Target
    misfit: Misfit
    coarse: Misfit
    path: ToolPath
    bounds: DwellBounds
    corridor_mm: float
    rounded: Rounded | None = None

    @property
    def grid(self) -> Grid:
        """Pixels of the map."""
        return grid_of(self.surface)

    @property
    def stage_path(self) -> ToolPath:
        """Nodes on the machine."""
        return ToolPath(*self.options.placement(self.path.x_mm, self.path.y_mm))

    def rms_nm(self, removal_nm: FloatArray) -> float:
        """RMS of the residual after a removal (ny, nx)."""
        return rms(self.target.residual_nm(removal_nm))

    def keeps(self, time_s: FloatArray) -> bool:
        """Whether executed times (n,) of the segments keep their upper bounds."""
        return bool((time_s <= self.bounds.upper_s + 0.5 * self.machine.sample_period_s).all())

    def check_times(self, time_s: FloatArray) -> None:
        """Refuse executed times (n,) that the machine's limits have lengthened beyond their upper bounds.

        Raises
        ------
        LimitsError
            With the step that is over by most.
        """
        if self.keeps(time_s):
            return
        over_s = time_s - self.bounds.upper_s
        worst = int(np.argmax(over_s))
        raise LimitsError(
            f"plan: the machine's limits lengthen {int((over_s > 0).sum())} of {time_s.size} steps beyond what "
            f"{self.options.v_min_mm_s:g} mm/s allows; the worst, to node {worst + 1}, takes {time_s[worst]:.4g} s "
            f"instead of {self.bounds.upper_s[worst]:.4g} s",
            "lower --v-min-mm-s, or take longer steps",
        )

    def schedule(self, dwell_s: FloatArray) -> PvtSchedule:
        """Schedule times (n,) of the segments, longer where the limits ask for it."""
        if self.rounded is not None:
            return self.rounded.schedule(dwell_s, self.machine)
        return schedule(self.stage_path, dwell_s, self.machine, self.corridor_mm, stretch=True)

    def problem(self, operator: RemovalOperator, lower_s: FloatArray) -> DwellProblem:
        """Least-squares problem of an operator on the cells, with lower bounds (n,)."""
        return DwellProblem(operator, self.misfit, lower_s, self.bounds.upper_s, self.path.straight)

    def ideal_problem(self, misfit: Misfit, precision: Precision = np.float32) -> DwellProblem:
        """Least-squares problem of the dwell points on the cells of `misfit`."""
        path = self.path
        operator = RemovalOperator(misfit.grid, misfit.influence, path.dwell_x_mm, path.dwell_y_mm, precision=precision)
        return DwellProblem(operator, misfit, self.bounds.lower_s, self.bounds.upper_s, path.straight)

    def after(self, removal_nm: FloatArray) -> PlanningJob:
        """Return the same job on what a removal (ny, nx) leaves of the map."""
        surface = replace(self.surface, height_nm=self.surface.height_nm - removal_nm)
        target = Target.of(surface, self.influence, self.target.clear_aperture, self.options)
        misfit, coarse = _misfits(surface, self.influence, target, self.options)
        return replace(self, surface=surface, target=target, misfit=misfit, coarse=coarse)


def prepare(
    surface: SurfaceMap,
    influence: InfluenceFunction,
    machine: MachineDescription,
    options: PlanOptions,
    path: ToolPath | None = None,
    mask: NDArray[np.bool_] | None = None,
) -> PlanningJob:
    """Check the inputs of a plan and lay its path, unless path and clear aperture are given.

    Raises
    ------
    InputError
        If the inputs do not fit each other.
    LimitsError
        If the path leaves the travel of an axis.
    """
    influence = seen_on_part(influence, options.placement)
    check_sizes(surface, influence)
    options = options.spaced(full_width_mm(influence))
    if mask is None:
        mask = clear_aperture_mask(surface, options.clear_aperture)
    target = Target.of(surface, influence, mask, options)
    if path is None:
        path = make_path(surface, target, influence, options)
    stage_path = ToolPath(*options.placement(path.x_mm, path.y_mm))
    misfit, coarse = _misfits(surface, influence, target, options)
    bounds, corridor_mm = step_bounds(stage_path, machine, options), corridor_of(options)
    walked: Rounded | None = None
    if options.corner_tolerance_mm is not None:
        walked = rounded(stage_path, machine, options.corner_tolerance_mm, corridor_mm)
        walked = walked.balanced(bounds.lower_s, machine)
    return PlanningJob(
        surface,
        influence,
        machine,
        options,
        target,
        misfit,
        coarse,
        path,
        bounds,
        corridor_mm,
        walked,
    )


def seen_on_part(influence: InfluenceFunction, placement: Placement) -> InfluenceFunction:
    """Return the tool of the machine as it works on a part that is placed so."""
    return influence.turned(placement.matrix) if placement.turned else influence


def _misfits(
    surface: SurfaceMap, influence: InfluenceFunction, target: Target, options: PlanOptions
) -> tuple[Misfit, Misfit]:
    """Target on cells, to finish and to search on."""
    mask, depth_nm = target.clear_aperture, target.depth_nm
    fine, coarse = (
        make_misfit(surface, mask, influence, options.remove, cell_size(surface, influence, per_width), depth_nm)
        for per_width in (CELLS_PER_WIDTH, COARSE_CELLS_PER_WIDTH)
    )
    return fine, coarse


def corridor_of(options: PlanOptions) -> float:
    """Corridor in mm: as chosen, or a share of the pitch."""
    corridor_mm = CORRIDOR_SHARE * options.spacing_mm[0] if options.corridor_mm is None else options.corridor_mm
    if not (np.isfinite(corridor_mm) and corridor_mm > 0):
        raise InputError(f"corridor is {corridor_mm:g} mm, it must be positive", "correct --corridor-mm")
    return corridor_mm
