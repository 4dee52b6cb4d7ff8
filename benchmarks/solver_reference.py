"""The bounded dwell solvers against scipy's dense bounded least squares on small jobs: the same objective."""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.optimize import lsq_linear

from ibfctl.dwell.compression import CompressedProblem, compress
from ibfctl.dwell.interior import first_point, solve_interior
from ibfctl.dwell.misfit import cell_size, make_misfit
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import Descent, DwellProblem, Regularisation
from ibfctl.path.raster import raster
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import Rectangle, SurfaceMap

FloatArray = NDArray[np.float64]

# A tool that a compressed problem can hold, on a part on which scipy still finishes.
HALF_X_MM, HALF_Y_MM, PIXEL_MM, PITCH_MM = 2.4, 2.0, 0.2, 0.6
TIF_FWHM_MM, TIF_RADIUS_MM, TIF_PEAK_NM_S = 1.6, 3.0, 8.0
LOWER_S, UPPER_S = 0.02, (np.inf, 0.3)
REGULARISATIONS = (
    Regularisation(),
    Regularisation(1e-6, 0.0),
    Regularisation(1e-6, 1e-4),
    Regularisation(1e-3, 0.0),
)
# Of a second, as a share of the squared target.
PRICE_SHARES = (0.0, 1e-5)
ITERATIONS, TOLERANCE, GAP_SHARE = 80_000, 1e-13, 1e-9


def run() -> dict[str, Any]:
    """Solve every combination of upper bound, regularisation and price; the worst relative error counts."""
    descent_errors, interior_errors, compression_errors, at_bounds = [], [], [], []
    begin = time.perf_counter()
    for upper_s, regularisation, price_share in product(UPPER_S, REGULARISATIONS, PRICE_SHARES):
        problem = small_problem(LOWER_S, upper_s)
        price = price_share * float(problem.misfit.target @ problem.misfit.target)
        descent = Descent(problem, regularisation, problem.lower_s)
        penalty = Penalty.of(problem, regularisation, descent.curvature, price)
        dense = dense_matrix(problem)
        best, best_s = reference(problem, dense, problem.misfit.target, penalty)
        at_bounds.append(float(((best_s <= LOWER_S) | (best_s >= upper_s)).mean()))
        descent.advance(price, ITERATIONS, TOLERANCE)
        descent_errors.append(descent.objective(price) / best - 1)
        if price == 0:
            continue  # the method for small jobs needs a price to start from
        small = compress(problem)
        assert small is not None
        time_s = interior_times(problem, small, penalty)
        small_best, _ = reference(problem, small.removal, small.target, penalty)
        interior_errors.append(objective(small.removal, small.target, penalty, time_s) / small_best - 1)
        compression_errors.append(objective(dense, problem.misfit.target, penalty, time_s) / best - 1)
    return {
        "metrics": {
            "objective_error": max(map(abs, descent_errors + interior_errors)),
            "descent_objective_error": max(map(abs, descent_errors)),
            "interior_objective_error": max(map(abs, interior_errors)),
            "compression_objective_error": max(map(abs, compression_errors)),
            "jobs": len(descent_errors),
            "steps": problem.operator.steps,
            "cells": problem.misfit.target.size,
            "mean_share_at_bounds": float(np.mean(at_bounds)),
            "duration_s": time.perf_counter() - begin,
        },
        "targets": {"objective_error": {"max": 1e-6}},
    }


@dataclass(frozen=True)
class Penalty:
    """What is added to half the squared residual: 1/2 λ |t|² + 1/2 μ/4 |D t|² + w Σ t."""

    tikhonov: float
    smoothing: float
    price: float
    changes: FloatArray

    @classmethod
    def of(cls, problem: DwellProblem, weights: Regularisation, curvature: float, price: float) -> Penalty:
        """Make the penalty of a problem; `weights` are relative to `curvature`."""
        changes = np.diff(np.eye(problem.operator.steps), axis=0)[problem.joined]
        return cls(weights.tikhonov * curvature, weights.smoothing * curvature, price, changes)


def small_problem(lower_s: float, upper_s: float) -> DwellProblem:
    """Make a job whose optimum lies on its bounds at many steps."""
    shape = round(2 * HALF_Y_MM / PIXEL_MM), round(2 * HALF_X_MM / PIXEL_MM)
    noise = ndimage.gaussian_filter(np.random.default_rng(3).normal(size=shape), 4.0)
    surface = SurfaceMap.centred(10 * noise / noise.std(), PIXEL_MM)
    influence = gaussian(TIF_FWHM_MM, TIF_PEAK_NM_S, TIF_RADIUS_MM, PIXEL_MM)
    overrun = influence.radius_mm
    area = Rectangle(-HALF_X_MM - overrun, HALF_X_MM + overrun, -HALF_Y_MM - overrun, HALF_Y_MM + overrun)
    path = raster(area, PITCH_MM, PITCH_MM)
    mask = np.ones(shape, dtype=bool)
    misfit = make_misfit(surface, mask, influence, "tilt", cell_size(surface, influence))
    operator = RemovalOperator(misfit.grid, misfit.influence, path.dwell_x_mm, path.dwell_y_mm)
    bounds = np.full(path.segments, lower_s), np.full(path.segments, upper_s)
    return DwellProblem(operator, misfit, *bounds, path.straight)


def dense_matrix(problem: DwellProblem) -> FloatArray:
    """Weighted, levelled removal of a second of each step, a column each."""
    return np.stack([problem.misfit.of(problem.operator(unit)) for unit in np.eye(problem.operator.steps)], axis=1)


def objective(
    matrix: FloatArray, target: FloatArray, penalty: Penalty, time_s: FloatArray
) -> float:
    """Value of the objective, written out."""
    residual, change = target - matrix @ time_s, penalty.changes @ time_s
    return float(
        0.5 * residual @ residual
        + 0.5 * penalty.tikhonov * time_s @ time_s
        + 0.125 * penalty.smoothing * change @ change
        + penalty.price * time_s.sum()
    )


def reference(
    problem: DwellProblem, matrix: FloatArray, target: FloatArray, penalty: Penalty
) -> tuple[float, FloatArray]:
    """Optimal objective and times by scipy; the price moves the centre of the Tikhonov term."""
    n, root = matrix.shape[1], np.sqrt(penalty.tikhonov)
    rows = np.vstack([matrix, root * np.eye(n), 0.5 * np.sqrt(penalty.smoothing) * penalty.changes])
    wanted = np.concatenate([target, np.full(n, -penalty.price / root), np.zeros(len(penalty.changes))])
    bounds = problem.lower_s, problem.upper_s
    time_s = np.clip(lsq_linear(rows, wanted, bounds, method="bvls", tol=1e-14, max_iter=20 * n).x, *bounds)
    return objective(matrix, target, penalty, time_s), time_s


def interior_times(problem: DwellProblem, small: CompressedProblem, penalty: Penalty) -> FloatArray:
    """Times by the method for small jobs."""
    return solve_interior(
        problem,
        small,
        tikhonov=penalty.tikhonov,
        smoothing=penalty.smoothing,
        price_nm2_s=penalty.price,
        start=first_point(problem, 1.0, penalty.price),
        tolerance=GAP_SHARE,
    ).time_s
