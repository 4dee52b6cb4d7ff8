"""Several tools as one: the times of all in one vector, their removals in one sum (Ke et al. 2022, Eq. 7)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.misfit import Misfit
from ibfctl.dwell.operator import Removal
from ibfctl.dwell.solver import DwellProblem

FloatArray = NDArray[np.float64]


class JointRemoval:
    """Linear map from the seconds that several tools spend on all their steps to what they remove together.

    Parameters
    ----------
    operators
        One per tool, all onto the same grid.

    Attributes
    ----------
    blocks : tuple of slice
        Where each tool's steps lie.
    """

    def __init__(self, operators: Sequence[Removal]) -> None:
        self._operators = tuple(operators)
        ends = np.cumsum([operator.steps for operator in operators])
        self.blocks = tuple(
            slice(int(end) - operator.steps, int(end)) for end, operator in zip(ends, operators, strict=True)
        )

    @property
    def steps(self) -> int:
        """Number of steps of all tools."""
        return self.blocks[-1].stop

    def __call__(self, time_s: FloatArray) -> FloatArray:
        """Removal (ny, nx) in nm for the times (n,) of all tools."""
        return np.asarray(
            sum(operator(time_s[block]) for operator, block in zip(self._operators, self.blocks, strict=True))
        )

    def adjoint(self, values: FloatArray) -> FloatArray:
        """Adjoint of the call: (n,) from values (ny, nx)."""
        return np.concatenate([operator.adjoint(values) for operator in self._operators])


def joint_problem(problems: Sequence[DwellProblem], misfit: Misfit) -> DwellProblem:
    """Join the problems of several tools on the same cells into one.

    Parameters
    ----------
    problems
        One per tool, all with the same clear aperture on the same grid.
    misfit
        What all together are to remove.
    """
    joined: list[NDArray[np.bool_]] = []
    for problem in problems:
        within = np.ones(problem.operator.steps - 1, dtype=bool) if problem.joined is None else problem.joined
        # The last step of a tool and the first of the next are not one motion.
        joined += [within, np.zeros(1, dtype=bool)]
    return DwellProblem(
        JointRemoval([problem.operator for problem in problems]),
        misfit,
        np.concatenate([problem.lower_s for problem in problems]),
        np.concatenate([problem.upper_s for problem in problems]),
        np.concatenate(joined[:-1]),
    )
