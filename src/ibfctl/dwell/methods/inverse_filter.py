"""Inverse filtering with a free threshold: dwell times by one division of spectra, as an instant preview.

The spectrum of the extended target is divided by that of the influence function, and a threshold bounds what that
amplifies; it is chosen by what the times leave over the clear aperture (the kind of the robust iterative Fourier
method, RIFTA: Wang et al. 2020, Sci. Rep. 10, 8135). Times are then offset until all are long enough. It sees a
regular grid, so it is exact only for dwell points that cover the part evenly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from ibfctl.dwell.methods.extension import dwell_points, extended
from ibfctl.dwell.methods.solution import Solution
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import Cancelled, DwellProblem, never
from ibfctl.errors import CancelledError

FloatArray = NDArray[np.float64]

# Thresholds of the spectrum's modulus, relative to its largest.
THRESHOLDS = tuple(float(share) for share in np.geomspace(5e-4, 0.5, 16))
# A higher threshold is a shorter time: the highest whose residual is within this share of the best.
MARGIN = 0.05


def inverse_filter(
    problem: DwellProblem, *, thresholds: tuple[float, ...] = THRESHOLDS, cancelled: Cancelled = never
) -> Solution:
    """Divide spectra at each threshold and take the shortest times that leave nearly the least.

    Parameters
    ----------
    problem
        Of a `RemovalOperator` whose steps are dwell points that cover the part evenly.
    thresholds
        Moduli to try, relative to the largest. Where the modulus is lower, the inverse falls with it to zero:
        components that the tool cannot remove are left alone, not amplified.

    Raises
    ------
    CancelledError
        When the planning was cancelled.
    """
    operator = dwell_points(problem)
    source = operator.source
    target, transfer = _spectra(problem, operator)
    modulus = np.abs(transfer)
    # A second at every dwell point against a second on every cell: how many cells a dwell point stands for.
    each = operator(np.ones(operator.steps))[problem.misfit.mask].mean()
    cells_per_point = float(problem.misfit.influence.rate_nm_s.sum() / each)
    tried = []
    for threshold in thresholds:
        if cancelled():
            raise CancelledError("planning was cancelled", "start it again when wanted")
        inverse = np.conj(transfer) / np.maximum(modulus, threshold * modulus.max()) ** 2
        on_cells = fft.irfft2(target * inverse, (2 * source.ny, 2 * source.nx))[: source.ny, : source.nx]
        tried.append(Solution(problem, offset(problem, cells_per_point * (operator.gather @ on_cells.ravel()))))
    allowed_nm = (1 + MARGIN) * min(solution.rms_nm for solution in tried)
    return min(
        (solution for solution in tried if solution.rms_nm <= allowed_nm), key=lambda solution: solution.total_time_s
    )


def offset(problem: DwellProblem, time_s: FloatArray) -> FloatArray:
    """Times (n,) lengthened by the same amount until none is too short, and cut to their upper bounds."""
    return np.asarray(np.minimum(time_s + (problem.lower_s - time_s).max(), problem.upper_s))


def _spectra(problem: DwellProblem, operator: RemovalOperator) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Spectra of the target and of the influence function.

    The target is mirrored at its edges, so that it has no jump where the transform closes it upon itself.
    """
    plane = extended(problem.misfit, operator.source)
    mirrored = np.block([[plane, plane[:, ::-1]], [plane[::-1], plane[::-1, ::-1]]])
    kernel = problem.misfit.influence.rate_nm_s
    ny, nx = kernel.shape
    rows, columns = np.arange(ny) - ny // 2, np.arange(nx) - nx // 2
    period_y, period_x = 2 * operator.source.ny, 2 * operator.source.nx
    folded = np.zeros((period_y, period_x))
    np.add.at(folded, (rows[:, None] % period_y, columns % period_x), kernel)
    return fft.rfft2(mirrored), fft.rfft2(folded)
