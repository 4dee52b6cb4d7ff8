"""Any path can be done under any limit of the jerk that a count allows, where times may be lengthened."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.schedule.certificate import axis_cubics
from ibfctl.schedule.scheduler import schedule
from tests.property.timed_paths import Job, jobs


@settings(max_examples=40)
@given(job=jobs(max_nodes=60, coarsest_counts_per_mm=1000.0), seconds=st.sampled_from([1e-3, 0.1, 3.0]))
def test_any_path_can_be_done_under_any_limit(job: Job, seconds: float) -> None:
    """The limit is what reaches an axis' largest acceleration in so many seconds."""
    jerk_mm_s3 = min(axis.a_max_mm_s2 for axis in job.machine.axes.values()) / seconds
    scheduled = schedule(job.path, job.dwell_s, job.machine, job.corridor_mm, stretch=True, jerk_max_mm_s3=jerk_mm_s3)
    assert scheduled.certificate.passed
    for axis in scheduled.program.axes.values():
        cubics = axis_cubics(scheduled.program, axis)
        change = cubics.end_acceleration - cubics.start_acceleration
        rounding = 1e-9 * np.maximum(np.abs(cubics.start_acceleration), jerk_mm_s3 * abs(axis.counts_per_mm))
        assert (np.abs(change) <= jerk_mm_s3 * abs(axis.counts_per_mm) * cubics.time_s + rounding).all()
