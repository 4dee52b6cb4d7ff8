"""The constant acceleration of the baselines visits every node of any path, whatever Eq. 7 does to its times."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings

from ibfctl.schedule.baselines.constant_acceleration import constant_acceleration
from tests.property.timed_paths import Job, jobs


@settings(max_examples=40)
@given(job=jobs(max_nodes=60))
def test_constant_acceleration_visits_every_node_of_any_path(job: Job) -> None:
    motion = constant_acceleration(job.path, np.maximum(job.dwell_s, 0.002), job.machine)
    ends_s = np.cumsum(np.bincount(motion.x.segment, motion.x.time_s, minlength=job.path.segments))
    for axis, node_mm in ((motion.x, job.path.x_mm), (motion.y, job.path.y_mm)):
        np.testing.assert_allclose(axis.position(ends_s), node_mm[1:], atol=1e-5)
    for coordinate, peak in motion.peak_acceleration_mm_s2.items():
        assert peak <= job.machine.axis_of(coordinate).a_max_mm_s2
