"""Dwell times with the problem that they are for: whoever holds them can check them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.solver import DwellProblem

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Solution:
    """What a method answers; every figure is computed from the problem, none is the method's own word.

    Attributes
    ----------
    problem
        What the times are for.
    time_s : (n,) float64
        Dwell times.
    """

    problem: DwellProblem
    time_s: FloatArray

    @cached_property
    def rms_nm(self) -> float:
        """RMS of the residual over the cells of the problem."""
        return self.problem.rms_nm(self.time_s)

    @property
    def total_time_s(self) -> float:
        """Sum of the times."""
        return float(self.time_s.sum())

    @cached_property
    def bound_violation_s(self) -> float:
        """How far the worst time lies outside its bounds; zero if all are kept."""
        below, above = self.problem.lower_s - self.time_s, self.time_s - self.problem.upper_s
        return float(max(0.0, below.max(), above.max()))

    @cached_property
    def distance_from_optimum(self) -> float:
        """Largest change that a step down the gradient within the bounds makes, relative to the largest time.

        Zero where no other times within the bounds leave less, and only there.
        """
        problem = self.problem
        descent = problem.descent(problem.residual(self.time_s))
        moved = np.clip(self.time_s + descent / problem.curvature(), problem.lower_s, problem.upper_s)
        return float(np.abs(moved - self.time_s).max() / max(moved.max(), 1e-300))
