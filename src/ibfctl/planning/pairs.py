"""Times corrected by whole pairs of samples, which rounding leaves alone.

Where a segment lasts only some pairs, rounding moves a solver's times by more than what is left to correct. Here the
times are integers from the begin: one pair more or less, or one that goes from a segment to another, whichever brings
the residual of the executed motion down the most, until none does (coordinate descent on integers).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.misfit import full_width_mm
from ibfctl.dwell.motion import executed_operator
from ibfctl.dwell.solver import Cancelled
from ibfctl.errors import CancelledError
from ibfctl.machine.program import IntArray
from ibfctl.planning.job import PlanningJob
from ibfctl.planning.loop import Executed, execute

FloatArray = NDArray[np.float64]

_PAIR = 2
_ROUNDS = 6
# So far around a place, in full widths of the tool, and so many segments at most.
_REACH, _MOST = 4.0, 800
_MOVES = 400
_EXACT = 1e-6


def corrected_around(
    job: PlanningJob, present: Executed, place: int, good_enough_nm: float, cancelled: Cancelled
) -> Executed:
    """Correct the times of the segments around one of them as far as that helps the motion as executed.

    Parameters
    ----------
    job, present
        What is planned, and its program so far.
    place
        The segment.
    good_enough_nm
        Residual at which there is nothing to do.
    cancelled
        Asked often; ends the search with `CancelledError`.

    Returns
    -------
    Executed
        Never worse than `present`.
    """
    best = present
    near = _near(job, place)
    for _ in range(_ROUNDS):
        if best.rms_nm <= good_enough_nm:
            break
        change = _changes(job, best, near, cancelled)
        if not change.any():
            break
        time_s = best.scheduled.segment_time_s.copy()
        time_s[near] += change * _PAIR * job.machine.sample_period_s
        tried = execute(job, time_s)
        if tried.rms_nm >= best.rms_nm or not job.keeps(tried.scheduled.segment_time_s):
            break
        best = tried
    return best


def _near(job: PlanningJob, place: int) -> IntArray:
    """Segments that the tool passes near one of them, the nearest of them where there are many."""
    path = job.path
    distance_mm = np.hypot(path.dwell_x_mm - path.dwell_x_mm[place], path.dwell_y_mm - path.dwell_y_mm[place])
    nearest = np.argsort(distance_mm, kind="stable")[:_MOST]
    return np.asarray(nearest[distance_mm[nearest] <= _REACH * full_width_mm(job.influence)])


def _changes(job: PlanningJob, present: Executed, near: IntArray, cancelled: Cancelled) -> IntArray:
    """Pairs (k,) to add to the times of segments `near`, by what one of each is worth on the present motion."""
    scheduled, misfit = present.scheduled, job.misfit
    segments = job.path.segments
    operator = executed_operator(
        scheduled.program,
        scheduled.source_segment,
        segments,
        misfit.grid,
        misfit.influence,
        placement=job.options.placement,
    )
    pair_s = _PAIR * job.machine.sample_period_s
    columns = np.empty((misfit.target.size, near.size))
    for k, segment in enumerate(near):
        if cancelled():
            raise CancelledError("planning was cancelled", "start it again when wanted")
        one = np.zeros(segments)
        one[segment] = pair_s
        columns[:, k] = misfit.of(operator(one))
    residual = misfit.target - misfit.of(operator(scheduled.segment_time_s))
    gram, slope = columns.T @ columns, columns.T @ residual
    time_s = scheduled.segment_time_s[near]
    least = np.ceil((job.bounds.lower_s[near] - time_s) / pair_s - _EXACT)
    most = np.floor((job.bounds.upper_s[near] - time_s) / pair_s + _EXACT)
    return descended(gram, slope, least, most)


def descended(gram: FloatArray, slope: FloatArray, least: FloatArray, most: FloatArray) -> IntArray:
    """Integers q (k,) within bounds that bring  1/2 q G q - b q  down, change by change, until no single one helps.

    Parameters
    ----------
    gram, slope
        G (k, k) and b (k,).
    least, most
        Bounds (k,), perhaps infinite.
    """
    q = np.zeros(slope.size, dtype=np.int64)
    slope = slope.copy()
    own = np.diag(gram)
    for _ in range(_MOVES):
        up = np.where(q < most, slope - own / 2, -np.inf)
        down = np.where(q > least, -slope - own / 2, -np.inf)
        swap = up[:, None] + down[None, :] + gram
        np.fill_diagonal(swap, -np.inf)
        more, less = np.unravel_index(int(np.argmax(swap)), swap.shape)
        best = max(float(up.max()), float(down.max()), float(swap[more, less]))
        if best <= 0:
            break
        moved = np.zeros(q.size, dtype=np.int64)
        if best == up.max():
            moved[int(np.argmax(up))] = 1
        elif best == down.max():
            moved[int(np.argmax(down))] = -1
        else:
            moved[more], moved[less] = 1, -1
        q += moved
        slope -= gram @ moved
    return q
