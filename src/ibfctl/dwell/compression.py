"""The few directions that a small job can correct, found by random probing.

An influence function is smooth, so the removal it can leave on a small aperture lives in a space of a few hundred
directions, however many cells and dwell points there are. A random range finder (Halko, Martinsson and Tropp 2011,
SIAM Rev. 53, 217) finds them with as many applications of the operator.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.misfit import full_width_mm
from ibfctl.dwell.solver import DwellProblem

FloatArray = NDArray[np.float64]

# Work of an iteration, directions squared times steps, beyond which a job is not small: tens of milliseconds.
MAX_WORK = 2e9
# Singular values below this share of the largest lie under any noise.
SMALLEST_SHARE = 5e-4


@dataclass(frozen=True)
class CompressedProblem:
    """A dwell problem on an orthonormal basis of what can be removed.

    Attributes
    ----------
    removal : (r, n) float64
        Removal of a second of each step along the r directions, weighted and levelled as in `Misfit`.
    target : (r,) float64
        What is to be removed along them, nm.
    """

    removal: FloatArray
    target: FloatArray


def compress(problem: DwellProblem) -> CompressedProblem | None:
    """Compress a problem; None where it needs too many directions."""
    cells, steps = problem.misfit.root_weight.size, problem.operator.steps
    expected = min(_expected_directions(problem), steps)
    if expected**2 * steps > MAX_WORK:
        return None
    random = np.random.default_rng(0)
    probes = min(int(1.2 * expected) + 20, cells, steps)
    sample = np.stack(
        [problem.misfit.of(problem.operator(random.standard_normal(problem.operator.steps))) for _ in range(probes)],
        axis=1,
    )
    basis, triangle = np.linalg.qr(sample)
    turn, size, _ = np.linalg.svd(triangle)
    kept = int((size > SMALLEST_SHARE * size[0]).sum())
    if kept == probes < min(cells, steps):
        return None
    basis = basis @ turn[:, :kept]
    removal = np.stack([problem.descent(direction) for direction in basis.T])
    return CompressedProblem(removal, basis.T @ problem.misfit.target)


def _expected_directions(problem: DwellProblem) -> float:
    """Number of cosines over the aperture's box that a Gaussian of the tool's width passes at `SMALLEST_SHARE`."""
    grid = problem.misfit.grid
    # exp(-2 (pi sigma f)^2) = share
    sigma_mm = full_width_mm(problem.misfit.influence) / np.sqrt(8 * np.log(2))
    cut_off = np.sqrt(-0.5 * np.log(SMALLEST_SHARE)) / (np.pi * sigma_mm)
    modes = [min(2 * cut_off * pixels * grid.pixel_mm + 4, pixels) for pixels in (grid.ny, grid.nx)]
    return float(modes[0] * modes[1])
