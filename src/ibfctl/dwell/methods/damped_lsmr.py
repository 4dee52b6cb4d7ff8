"""Damped LSMR with a searched damping factor, and times offset until none is too short.

The method of Ke et al. 2022, Opt. Express 30, Algorithms 1 (one tool) and 2 (several). LSMR of a
damped system walks the same Krylov space whatever the damping (Fong and Saunders 2011, SIAM J. Sci. Comput. 33, 2950).
The space is built once, and every factor of the search costs a small dense least squares in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.methods.extension import extended_problem
from ibfctl.dwell.methods.solution import Solution
from ibfctl.dwell.solver import Cancelled, DwellProblem, never
from ibfctl.errors import CancelledError

FloatArray = NDArray[np.float64]

# The paper's: iterations, and the change of the merit at which the search for the damping ends.
ITERATIONS = 100
TOLERANCE_NM = 1e-3
# Damping factors of the first look, relative to the largest singular value.
_FIRST_LOOK = tuple(float(factor) for factor in np.geomspace(1e-6, 1.0, 13))


@dataclass(frozen=True)
class KrylovSpace:
    """Golub-Kahan bidiagonalisation of a problem's levelled operator A: A V = U B, with orthonormal columns.

    Attributes
    ----------
    basis : (n, k) float64
        V.
    bidiagonal : (k + 1, k) float64
        B, in nm/s.
    beyond_nm_s : float
        The element of B after its last column: how the space would go on.
    target_nm : float
        Norm of the target.
    """

    basis: FloatArray
    bidiagonal: FloatArray
    beyond_nm_s: float
    target_nm: float

    @property
    def largest_nm_s(self) -> float:
        """Largest singular value in the space."""
        return float(np.linalg.norm(self.bidiagonal, 2))

    def lsmr(self, damping_nm_s: float) -> FloatArray:
        """Iterate (n,) of LSMR: the times in the space with the least normal residual of the damped system."""
        size = self.bidiagonal.shape[1]
        normal = np.zeros((size + 1, size))
        normal[:size] = self.bidiagonal.T @ self.bidiagonal + damping_nm_s**2 * np.eye(size)
        normal[size, size - 1] = self.beyond_nm_s * self.bidiagonal[size, size - 1]
        wanted = np.zeros(size + 1)
        wanted[0] = self.bidiagonal[0, 0] * self.target_nm
        return np.asarray(self.basis @ np.linalg.lstsq(normal, wanted, rcond=None)[0])


def krylov_space(problem: DwellProblem, iterations: int = ITERATIONS, cancelled: Cancelled = never) -> KrylovSpace:
    """Bidiagonalise a problem in at most `iterations` steps, with full reorthogonalisation.

    Raises
    ------
    CancelledError
        When the planning was cancelled.
    """
    target = problem.misfit.target
    target_nm = float(np.linalg.norm(target))
    most = max(1, min(iterations, problem.operator.steps, target.size - 1))
    right, left = np.empty((most, problem.operator.steps)), np.empty((most + 1, target.size))
    bidiagonal = np.zeros((most + 1, most))
    left[0] = target / max(target_nm, np.finfo(float).tiny)
    back = problem.descent(left[0])
    for k in range(most):
        if cancelled():
            raise CancelledError("planning was cancelled", "start it again when wanted")
        right[k], bidiagonal[k, k] = _new_direction(back, right[:k])
        removal = problem.misfit.of(problem.operator(right[k]))
        left[k + 1], bidiagonal[k + 1, k] = _new_direction(removal, left[: k + 1])
        back = problem.descent(left[k + 1])
    _, beyond = _new_direction(back, right)
    return KrylovSpace(right.T, bidiagonal, beyond, target_nm)


def damped_lsmr(
    problem: DwellProblem,
    *,
    extend: bool = False,
    blocks: Sequence[slice] = (slice(None),),
    iterations: int = ITERATIONS,
    cancelled: Cancelled = never,
) -> Solution:
    """Search the damping whose times, offset to be long enough, leave the least.

    Parameters
    ----------
    extend
        Solve on the surface extended over what the dwell points cover, against steep times at its edge.
    blocks
        Steps that are lengthened together until none is too short: those of one tool. All by default.
    iterations
        Of LSMR.

    Returns
    -------
    Solution
        Of `problem` itself, also where it was found on the extended surface.

    Raises
    ------
    CancelledError
        When the planning was cancelled.
    """
    space = krylov_space(extended_problem(problem) if extend else problem, iterations, cancelled)

    def at(log_damping: float) -> Solution:
        time_s = space.lsmr(space.largest_nm_s * 10**log_damping)
        for block in blocks:
            time_s[block] += (problem.lower_s[block] - time_s[block]).max()
        return Solution(problem, np.minimum(time_s, problem.upper_s))

    return at(_pattern_search(lambda log_damping: at(log_damping).rms_nm))


def _new_direction(vector: FloatArray, known: FloatArray) -> tuple[FloatArray, float]:
    """Direction of a vector beyond the orthonormal rows of `known` (k, n), and its size there."""
    # Gram-Schmidt twice is enough.
    for _ in range(2):
        vector = vector - (known @ vector) @ known
    size = float(np.linalg.norm(vector))
    return vector / max(size, np.finfo(float).tiny), size


def _pattern_search(merit: Callable[[float], float]) -> float:
    """Logarithm of the damping with the least merit, in nm: a first look, then ever smaller steps to either side."""
    looked = {float(np.log10(factor)): merit(float(np.log10(factor))) for factor in _FIRST_LOOK}
    place = min(looked, key=lambda here: looked[here])
    least, step = looked[place], 0.25
    while step > 1e-3:
        tried = min((merit(place + way * step), place + way * step) for way in (-1, 1))
        gain = least - tried[0]
        if gain > 0:
            least, place = tried
        else:
            step /= 2
        if 0 < gain < TOLERANCE_NM:
            break
    return place
