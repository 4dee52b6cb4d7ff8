"""Whether rounding the corners pays: the same dwell times on the sharp path, and how gently the rounded one does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.solver import Cancelled
from ibfctl.errors import CancelledError
from ibfctl.planning.job import PlanningJob, corridor_of
from ibfctl.planning.loop import TIME_SLACK, Executed, execute
from ibfctl.planning.plan import Smoothing, peaks

# Shares of the sharp path's peak accelerations that are tried one after the other.
_SHARES = (0.6, 0.7, 0.85)

def sharp_job(job: PlanningJob) -> PlanningJob:
    """Return the same job with its corners as programmed."""
    return replace(job, rounded=None, corridor_mm=corridor_of(job.options))


def gentlest(
    job: PlanningJob, sharp: Executed, dwell_s: NDArray[np.float64], cancelled: Cancelled
) -> tuple[PlanningJob, Executed]:
    """Lower the accelerations of a rounded path as far as its time stays that of the sharp one.

    Parameters
    ----------
    job
        With rounded corners.
    sharp
        The program of the sharp path for the dwell times (n,).

    Returns
    -------
    job, executed
        With the accelerations to stay below, and its program for the dwell times; where no corner slows the motion
        down there is nothing to gain, and all stays as it is.
    """
    assert job.rounded is not None
    peak = {letter: peak for letter, (_, peak) in peaks(sharp.scheduled.program).items()}
    if not job.rounded.smoothed.corners.transition_mm.any():
        return job, execute(job, dwell_s)
    rounded = job.rounded.balanced(dwell_s, job.machine)
    longest_s = (1 + TIME_SLACK) * sharp.scheduled.program.total_time_s
    for share in _SHARES:
        if cancelled():
            raise CancelledError("planning was cancelled", "start it again when wanted")
        limits = {letter: share * value for letter, value in peak.items()}
        gentle = replace(job, rounded=replace(rounded, a_max_mm_s2=limits))
        found = execute(gentle, dwell_s)
        if found.scheduled.program.total_time_s <= longest_s:
            return gentle, found
    gentle = replace(job, rounded=rounded)
    return gentle, execute(gentle, dwell_s)


def compared(job: PlanningJob, sharp: Executed, found: Executed) -> Smoothing:
    """Figures of a rounded path beside the sharp one."""
    assert job.rounded is not None
    corners = job.rounded.smoothed.corners
    before, after = sharp.scheduled.program, found.scheduled.program
    sharp_peak = {letter: peak for letter, (_, peak) in peaks(before).items()}
    lowers = []
    if after.total_time_s <= (1 + TIME_SLACK) * before.total_time_s:
        if found.rms_nm < sharp.rms_nm:
            lowers.append("residual")
        if all(peak < sharp_peak[letter] for letter, (_, peak) in peaks(after).items()):
            lowers.append("acceleration")
    return Smoothing(
        job.rounded.smoothed.tolerance_mm,
        found.scheduled.certificate["deviation_mm"].value,
        int(np.count_nonzero(corners.transition_mm)),
        sharp.rms_nm,
        before.total_time_s,
        sharp_peak,
        tuple(lowers),
    )
