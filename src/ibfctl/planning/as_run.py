"""What was removed, from where the stages really were while the beam was on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.deposition import grid_of
from ibfctl.dwell.operator import removal_of_samples
from ibfctl.errors import InputError
from ibfctl.planning.job import seen_on_part
from ibfctl.planning.plan import Plan
from ibfctl.planning.sequence import PlanSequence
from ibfctl.planning.target import Target
from ibfctl.surface.levelling import peak_to_valley, rms

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class AsRun:
    """As-run figures of a plan that predicts a residual.

    Attributes
    ----------
    removal_nm : (ny, nx)
        Removal along the trace.
    residual_nm : (ny, nx)
        What it leaves, levelled over the clear aperture, NaN outside.
    rms_nm, pv_nm
        Of the residual.
    max_difference_nm, rms_difference_nm
        As-run against executed removal over the clear aperture.
    """

    removal_nm: FloatArray
    residual_nm: FloatArray
    rms_nm: float
    pv_nm: float
    max_difference_nm: float
    rms_difference_nm: float


def as_run_figures(plan: Plan, x_mm: FloatArray, y_mm: FloatArray, sample_period_s: float) -> AsRun:
    """Compute the as-run residual from a trace.

    Parameters
    ----------
    plan
        The plan that was run.
    x_mm, y_mm : (n,) float64
        Positions of the stages at every sample at which the gate was open.
    sample_period_s
        Length of a sample.

    Raises
    ------
    InputError
        If the plan is a mere schedule, without map and influence function, or the gate was never open.
    """
    if plan.surface is None or plan.influence is None or plan.prediction is None:
        raise InputError("as-run figures: the plan holds no map", "make it with `ibfctl plan`, not `ibfctl schedule`")
    if not x_mm.size:
        raise InputError(
            "as-run figures: the gate was never open in the trace", "check the beam gate's output and sense"
        )
    surface, mask = plan.surface, plan.prediction.clear_aperture
    grid, influence = grid_of(surface), seen_on_part(plan.influence, plan.options.placement)
    place_mm = plan.options.placement.inverse(x_mm, y_mm)
    removal_nm = removal_of_samples(grid, influence, *place_mm, np.array(sample_period_s))
    target = Target.of(surface, influence, mask, plan.options)
    return _figures(target, plan.prediction.executed_removal_nm, removal_nm)


def as_run_together(sequence: PlanSequence, removal_nm: FloatArray) -> AsRun:
    """Compute the as-run residual of several tools from what all together have removed, `removal_nm` (ny, nx)."""
    plan, prediction = sequence.plans[0], sequence.prediction
    if plan.influence is None:
        raise InputError("as-run figures: the plan holds no tool", "make it with `ibfctl plan --tool`")
    influence = seen_on_part(plan.influence, plan.options.placement)
    target = Target.of(sequence.surface, influence, prediction.clear_aperture, plan.options)
    return _figures(target, prediction.executed_removal_nm, removal_nm)


def _figures(target: Target, predicted_nm: FloatArray, removal_nm: FloatArray) -> AsRun:
    """Figures of a removal (ny, nx), against the predicted one."""
    mask = target.clear_aperture
    residual_nm = target.residual_map_nm(removal_nm)
    difference_nm = (removal_nm - predicted_nm)[mask]
    return AsRun(
        removal_nm,
        residual_nm,
        rms(residual_nm[mask]),
        peak_to_valley(residual_nm[mask]),
        float(np.abs(difference_nm).max()),
        rms(difference_nm),
    )
