"""Motion in the loop: dwell times corrected for the cubics that the controller really executes.

Times that are best for dwell points are not best for the motion between them. Each round takes the removal operator
of the present program, corrects the times on it, schedules anew, and searches along the line from the old times to
the new ones for the smallest residual as executed. What a round finds is kept only if it is better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.motion import executed_operator, executed_removal
from ibfctl.dwell.solver import Cancelled, Descent, Regularisation
from ibfctl.errors import CancelledError
from ibfctl.planning.job import PlanningJob
from ibfctl.planning.plan import Round
from ibfctl.schedule.scheduler import PvtSchedule

FloatArray = NDArray[np.float64]

MAX_ROUNDS = 12
ITERATIONS = 80
# An operator holds for times near those of its motion: no time moves as if its curvature were below this share.
LEAST_CURVATURE = 0.3
LINE_SEARCH = (1.0, 0.5, 0.25, 0.1, 0.03)
# A round that gains less than this share of the residual is the last.
WORTHWHILE = 0.003
# Where the motion as executed wants more time than there is, time gets so much dearer, so many times at most.
DEARER, DEARER_TRIES = 1.3, 12
# A round may not cost more time than this share.
TIME_SLACK = 0.005


@dataclass(frozen=True)
class Executed:
    """A certified program and what it leaves.

    Attributes
    ----------
    asked_s : (n,) float64
        Dwell times asked of the scheduler.
    scheduled
        The program with its certificate.
    removal_nm : (ny, nx) float64
        Removal along its cubics.
    rms_nm
        RMS of the executed residual.
    """

    asked_s: FloatArray
    scheduled: PvtSchedule
    removal_nm: FloatArray
    rms_nm: float


def execute(job: PlanningJob, dwell_s: FloatArray) -> Executed:
    """Schedule dwell times (n,) and predict what the executed cubics leave."""
    return executed(job, dwell_s, job.schedule(dwell_s))


def executed(job: PlanningJob, dwell_s: FloatArray, scheduled: PvtSchedule) -> Executed:
    """Predict what the cubics of a schedule leave that was made for dwell times (n,)."""
    removal_nm = executed_removal(scheduled.program, job.grid, job.influence, placement=job.options.placement)
    return Executed(dwell_s, scheduled, removal_nm, job.rms_nm(removal_nm))


def refine(
    job: PlanningJob,
    plain: Executed,
    price_nm2_s: float,
    regularisation: Regularisation,
    cancelled: Cancelled,
    run_time_s: float | None = None,
) -> tuple[Executed, tuple[Round, ...]]:
    """Correct the times of a plain plan for its executed motion, until that no longer pays.

    Parameters
    ----------
    plain
        The plain chain's program.
    price_nm2_s
        Price on time at which the plain times were solved.
    run_time_s
        Time to keep; that of `plain` by default.

    Returns
    -------
    best, rounds
        Never worse than `plain`.
    """
    best = plain
    rounds = [_round(plain, accepted=True)]
    longest_s = (1 + TIME_SLACK) * (run_time_s or plain.scheduled.program.total_time_s)
    for _ in range(MAX_ROUNDS):
        wanted_s = _corrected(job, best, price_nm2_s, longest_s, regularisation, cancelled)
        found = best
        for share in LINE_SEARCH:
            asked_s = best.asked_s + share * (wanted_s - best.asked_s)
            # No schedule is shorter than what is asked of it.
            if asked_s.sum() > longest_s:
                continue
            if cancelled():
                raise CancelledError("planning was cancelled", "start it again when wanted")
            tried = execute(job, asked_s)
            scheduled = tried.scheduled
            in_time = scheduled.program.total_time_s <= longest_s and job.keeps(scheduled.segment_time_s)
            if tried.rms_nm < found.rms_nm and in_time:
                found = tried
                break
        gain = 1 - found.rms_nm / best.rms_nm if best.rms_nm > 0 else 0.0
        best = found
        rounds.append(_round(best, accepted=gain > 0))
        if gain < WORTHWHILE:
            break
    return best, tuple(rounds)


def _corrected(
    job: PlanningJob,
    present: Executed,
    price_nm2_s: float,
    longest_s: float,
    regularisation: Regularisation,
    cancelled: Cancelled,
) -> FloatArray:
    """Times (n,) of at most `longest_s` together that are best on the removal operator of the present program."""
    scheduled = present.scheduled
    operator = executed_operator(
        scheduled.program,
        scheduled.source_segment,
        job.path.segments,
        job.misfit.grid,
        job.misfit.influence,
        precision=np.float32,
        placement=job.options.placement,
    )
    # Where the limits asked for more time than wanted, less is no use.
    given_s = scheduled.segment_time_s
    stretched = given_s > present.asked_s + 3 * job.machine.sample_period_s
    problem = job.problem(operator, np.where(stretched, given_s, job.bounds.lower_s))
    curvature = float(problem.curvatures.max())
    descent = Descent(problem, regularisation, given_s, cancelled, curvature, LEAST_CURVATURE)
    descent.advance(price_nm2_s, ITERATIONS, 1e-6)
    for _ in range(DEARER_TRIES):
        if descent.time_s.sum() <= longest_s:
            break
        price_nm2_s *= DEARER
        descent.advance(price_nm2_s, ITERATIONS, 1e-6)
    return descent.time_s


def _round(executed: Executed, *, accepted: bool) -> Round:
    return Round(executed.rms_nm, executed.scheduled.program.total_time_s, accepted)
