"""Surface extension: what a tool that overruns the clear aperture is to find beyond its edge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ibfctl.dwell.deposition import Grid
from ibfctl.dwell.misfit import Misfit
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import DwellProblem
from ibfctl.surface.levelling import Levelling

FloatArray = NDArray[np.float64]

# Removal of even dwell times, relative to the largest, where the surface still counts as covered.
_COVERED = 0.9


def extended(misfit: Misfit, grid: Grid) -> FloatArray:
    """Target (ny, nx) in nm on a grid in line with the cells, each cell beyond them as the nearest of them."""
    row = round((misfit.grid.y0_mm - grid.y0_mm) / grid.pixel_mm)
    column = round((misfit.grid.x0_mm - grid.x0_mm) / grid.pixel_mm)
    rows, columns = np.nonzero(misfit.mask)
    known, values = np.zeros((grid.ny, grid.nx), dtype=bool), np.zeros((grid.ny, grid.nx))
    inside = _within(rows + row, grid.ny) & _within(columns + column, grid.nx)
    place = rows[inside] + row, columns[inside] + column
    known[place] = True
    values[place] = (misfit.target / misfit.root_weight)[inside]
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)])


def dwell_points(problem: DwellProblem) -> RemovalOperator:
    """Return the operator of a problem of one tool, which knows where its dwell points lie.

    Raises
    ------
    TypeError
        If the problem is one of several tools.
    """
    if not isinstance(problem.operator, RemovalOperator):
        raise TypeError("only the dwell points of one tool cover a grid")
    return problem.operator


def extended_problem(problem: DwellProblem) -> DwellProblem:
    """Return the problem with the extended target, as far as the dwell points cover it evenly.

    Beyond that the tool works from one side alone, and would be asked for mountains of time. Piston alone is free.
    """
    misfit, grid = problem.misfit, dwell_points(problem).source
    operator = dwell_points(problem).on(grid, misfit.influence)
    covered = operator(np.ones(operator.steps))
    mask = covered >= _COVERED * covered.max()
    root_weight = np.full(int(mask.sum()), mask.sum() ** -0.5)
    levelling = Levelling.over(mask, "piston", root_weight)
    target = levelling(extended(misfit, grid)[mask] * root_weight)
    return replace(
        problem, operator=operator, misfit=Misfit(grid, mask, root_weight, target, levelling, misfit.influence)
    )


def _within(index: NDArray[np.int64], size: int) -> NDArray[np.bool_]:
    return np.asarray((index >= 0) & (index < size))
