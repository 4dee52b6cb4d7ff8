"""A dwell problem that scipy's dense reference still solves in a moment."""

from __future__ import annotations

import numpy as np

from ibfctl.dwell.misfit import make_misfit
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import DwellProblem
from ibfctl.path.raster import raster
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.map import Rectangle, SurfaceMap


def make_problem(lower_s: float, upper_s: float, influence: InfluenceFunction | None = None) -> DwellProblem:
    """A part of 4 x 3 mm under a raster of 0.6 mm; at the optimum many times lie on their bounds."""
    random = np.random.default_rng(8)
    y, x = np.mgrid[-1:1:15j, -1:1:20j]
    surface = SurfaceMap.centred(4 * np.cos(3 * x) * y + x**2 + 0.3 * random.normal(size=x.shape), 0.2)
    tool = influence or gaussian(1.2, 6.0, 1.2, 0.2)
    path = raster(Rectangle(-3.0, 3.0, -2.4, 2.4), 0.6, 0.6)
    misfit = make_misfit(surface, np.ones(x.shape, dtype=bool), tool, "tilt", 1)
    operator = RemovalOperator(misfit.grid, misfit.influence, path.dwell_x_mm, path.dwell_y_mm)
    n = path.segments
    return DwellProblem(operator, misfit, np.full(n, lower_s), np.full(n, upper_s), path.straight)


def dense(problem: DwellProblem) -> np.ndarray:
    units = np.eye(problem.operator.steps)
    return np.stack([problem.misfit.of(problem.operator(unit)) for unit in units], axis=1)
