"""What a plan is made for, checked: the map, its clear aperture, the tool, the path over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.deposition import Grid, grid_of
from ibfctl.dwell.misfit import (
    CELLS_PER_WIDTH,
    COARSE_CELLS_PER_WIDTH,
    Misfit,
    cell_size,
    make_misfit,
)
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import DwellProblem
from ibfctl.errors import InputError
from ibfctl.machine.description import MachineDescription
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.aperture import check_sizes, clear_aperture_mask
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.paths import make_path
from ibfctl.schedule.scheduler import shortest_times
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.levelling import Levelling, rms
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]

# Corridor as a share of the pitch, where none is given.
CORRIDOR_SHARE = 0.05


@dataclass(frozen=True)
class PlanningJob:
    """Inputs of one plan and what follows from them directly.

    Attributes
    ----------
    surface, influence, machine, options
        As given.
    clear_aperture : (ny, nx) bool
        Pixels that count.
    levelling
        Free terms over the clear aperture.
    target_nm : (m,) float64
        Levelled height of the pixels of the clear aperture.
    misfit, coarse
        The same, averaged over cells, for the solver to finish and to search on.
    path
        Nodes; its overrun included.
    lower_s : (n,) float64
        Shortest time of each segment.
    corridor_mm
        How far the motion may leave a segment.
    """

    surface: SurfaceMap
    influence: InfluenceFunction
    machine: MachineDescription
    options: PlanOptions
    clear_aperture: NDArray[np.bool_]
    levelling: Levelling
    target_nm: FloatArray
    misfit: Misfit
    coarse: Misfit
    path: ToolPath
    lower_s: FloatArray
    corridor_mm: float

    @property
    def grid(self) -> Grid:
        """Pixels of the map."""
        return grid_of(self.surface)

    def residual_nm(self, removal_nm: FloatArray) -> FloatArray:
        """Levelled residual (m,) of the clear aperture after a removal (ny, nx)."""
        return np.asarray(self.target_nm - self.levelling(removal_nm[self.clear_aperture]))

    def rms_nm(self, removal_nm: FloatArray) -> float:
        """RMS of the residual after a removal (ny, nx)."""
        return rms(self.residual_nm(removal_nm))

    def residual_map_nm(self, removal_nm: FloatArray) -> FloatArray:
        """Residual (ny, nx), NaN outside the clear aperture."""
        result = np.full(self.clear_aperture.shape, np.nan)
        result[self.clear_aperture] = self.residual_nm(removal_nm)
        return result

    def problem(self, operator: RemovalOperator, lower_s: FloatArray) -> DwellProblem:
        """Least-squares problem of an operator on the cells, with lower bounds (n,)."""
        return DwellProblem(operator, self.misfit, lower_s, np.full(lower_s.size, np.inf), self.path.straight)

    def ideal_problem(self, misfit: Misfit) -> DwellProblem:
        """Least-squares problem of the dwell points on the cells of `misfit`."""
        path = self.path
        operator = RemovalOperator(
            misfit.grid, misfit.influence, path.dwell_x_mm, path.dwell_y_mm, precision=np.float32
        )
        return DwellProblem(operator, misfit, self.lower_s, np.full(self.lower_s.size, np.inf), path.straight)


def prepare(
    surface: SurfaceMap, influence: InfluenceFunction, machine: MachineDescription, options: PlanOptions
) -> PlanningJob:
    """Check the inputs of a plan and lay its path.

    Raises
    ------
    InputError
        If the inputs do not fit each other.
    LimitsError
        If the path leaves the travel of an axis.
    """
    check_sizes(surface, influence)
    mask = clear_aperture_mask(surface, options.clear_aperture)
    levelling = Levelling.over(mask, options.remove)
    path = make_path(surface, mask, influence, options)
    misfit, coarse = (
        make_misfit(surface, mask, influence, options.remove, cell_size(surface, influence, per_width))
        for per_width in (CELLS_PER_WIDTH, COARSE_CELLS_PER_WIDTH)
    )
    lower_s = shortest_times(path, machine)
    if options.dwell_min_s is not None:
        if not (np.isfinite(options.dwell_min_s) and options.dwell_min_s >= 0):
            raise InputError(f"dwell_min_s is {options.dwell_min_s:g}", "give a time of zero or more seconds")
        lower_s = np.maximum(lower_s, options.dwell_min_s)
    return PlanningJob(
        surface,
        influence,
        machine,
        options,
        mask,
        levelling,
        levelling(surface.height_nm[mask]),
        misfit,
        coarse,
        path,
        lower_s,
        corridor_of(options),
    )


def corridor_of(options: PlanOptions) -> float:
    """Corridor in mm: as chosen, or a share of the pitch."""
    corridor_mm = CORRIDOR_SHARE * options.pitch_mm if options.corridor_mm is None else options.corridor_mm
    if not (np.isfinite(corridor_mm) and corridor_mm > 0):
        raise InputError(f"corridor is {corridor_mm:g} mm, it must be positive", "correct --corridor-mm")
    return corridor_mm
