"""What is left of the error while a plan is being executed: the residual as a function of its progress."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.deposition import grid_of
from ibfctl.dwell.motion import PREDICTION_POINTS, motion_points, points_per_segment
from ibfctl.dwell.operator import removal_of_samples
from ibfctl.planning.job import seen_on_part
from ibfctl.planning.plan import Plan
from ibfctl.planning.target import Target
from ibfctl.surface.levelling import rms

FloatArray = NDArray[np.float64]

CHECKPOINTS = 24


@dataclass(frozen=True)
class ResidualAlong:
    """Residual at checkpoints of a plan.

    Attributes
    ----------
    plan_sample : (k,) float64
        Samples from the plan's begin, ascending from 0 to its end.
    rms_nm : (k,) float64
        Residual over the clear aperture once that much has been executed.
    """

    plan_sample: FloatArray
    rms_nm: FloatArray

    def at(self, plan_sample: float) -> float:
        """Residual between the checkpoints, linearly."""
        return float(np.interp(plan_sample, self.plan_sample, self.rms_nm))


def residual_along(plan: Plan, checkpoints: int = CHECKPOINTS) -> ResidualAlong | None:
    """Predict the residual along a plan; None where the plan has no map.

    Removals add up, so each checkpoint costs one convolution.
    """
    if plan.surface is None or plan.influence is None or plan.prediction is None:
        return None
    grid, influence = grid_of(plan.surface), seen_on_part(plan.influence, plan.options.placement)
    target = Target.of(plan.surface, influence, plan.prediction.clear_aperture, plan.options)
    points = max(PREDICTION_POINTS, points_per_segment(plan.program, influence))
    motion = motion_points(plan.program, points, plan.options.placement)
    ends = np.concatenate([[0], np.cumsum(plan.program.time_samples)]).astype(np.float64)
    nodes = np.unique(np.searchsorted(ends, np.linspace(0.0, ends[-1], checkpoints + 1)))
    removal_nm = np.zeros((grid.ny, grid.nx))
    left_nm = [rms(target.residual_nm(removal_nm))]
    for first, last in pairwise(nodes):
        part = slice(first, last)
        removal_nm = removal_nm + removal_of_samples(
            grid, influence, motion.x_mm[part].ravel(), motion.y_mm[part].ravel(), motion.time_s[part].ravel()
        )
        left_nm.append(rms(target.residual_nm(removal_nm)))
    return ResidualAlong(ends[nodes], np.array(left_nm))
