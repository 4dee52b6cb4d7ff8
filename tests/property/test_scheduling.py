"""Any timed path becomes a certified program, or an error that says which nodes need more time."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import assume, given, settings

from ibfctl.errors import LimitsError
from ibfctl.machine.program import MAX_SEGMENT_SAMPLES
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.certificate import axis_cubics, certify
from ibfctl.schedule.scheduler import PvtSchedule, schedule, shortest_times
from tests.property.timed_paths import Job, jobs, make_machine

NAMED = re.compile(r"node (\d+) \([^)]*\) \+([0-9.]+) s")
CORRIDOR_MM = 0.025


def check(scheduled: PvtSchedule, job: Job) -> None:
    """Whatever the certificate says: node positions, times and limits from the integers by another route."""
    program, machine = scheduled.program, job.machine
    assert scheduled.certificate.passed
    period_s = machine.sample_period_s
    by_segment_s = np.bincount(scheduled.source_segment, program.time_samples * period_s, minlength=job.path.segments)
    np.testing.assert_allclose(by_segment_s, scheduled.segment_time_s, rtol=1e-12)
    last_pieces = np.flatnonzero(np.diff(scheduled.source_segment, append=-1))
    places = {}
    for coordinate, node_mm in (("x", job.path.x_mm), ("y", job.path.y_mm)):
        axis, limits = program.axis_of(coordinate), machine.axis_of(coordinate)
        ends = axis.start_counts + np.cumsum(axis.increment_counts)
        at_nodes = np.concatenate([[axis.start_counts], ends[last_pieces]])
        assert np.abs(at_nodes - node_mm * limits.signed_counts_per_mm).max() <= 0.5 + 1e-6
        cubics = axis_cubics(program, axis)
        tau = np.linspace(0.0, 1.0, 33) * cubics.time_s[:, None]
        velocity = cubics.velocity(tau) / axis.counts_per_mm
        position = cubics.position(tau) / axis.counts_per_mm
        assert np.abs(velocity).max() <= limits.v_max_mm_s * (1 + 1e-9)
        move = np.sign(axis.increment_counts / axis.counts_per_mm)[:, None]
        assert (velocity * move >= -1e-9 * limits.v_max_mm_s).all()
        assert (np.where(move == 0, velocity, 0.0) == 0).all()
        # Acceleration from second differences: exact for a cubic at the middle of three samples.
        step = cubics.time_s[:, None] / 32
        acceleration = np.diff(velocity, axis=1) / step
        assert np.abs(acceleration).max() <= limits.a_max_mm_s2 * (1 + 1e-6)
        if limits.j_max_mm_s3 is not None:
            jerk = np.diff(acceleration, axis=1) / step
            noise = 1e-12 * limits.v_max_mm_s / step**2
            assert (np.abs(jerk) <= limits.j_max_mm_s3 * (1 + 1e-6) + noise).all()
        places[coordinate] = position
    x, y = places["x"], places["y"]
    dx, dy = x[:, -1:] - x[:, :1], y[:, -1:] - y[:, :1]
    length = np.where(np.hypot(dx, dy) > 0, np.hypot(dx, dy), 1.0)
    distance = np.abs((x - x[:, :1]) * dy - (y - y[:, :1]) * dx) / length
    assert distance.max() <= job.corridor_mm * (1 + 1e-9)


@settings(max_examples=150)
@given(jobs())
def test_with_stretching_every_timed_path_gives_a_certified_program(job: Job):
    scheduled = schedule(job.path, job.dwell_s, job.machine, job.corridor_mm, stretch=True)
    check(scheduled, job)
    # Stretching adds time; but for rounding to pairs it never takes any away.
    drift_s = np.cumsum(scheduled.segment_time_s - job.dwell_s)
    assert drift_s.min() >= -job.machine.sample_period_s * (1 + 1e-6)


@settings(max_examples=35)
@given(jobs(max_nodes=40))
def test_without_stretching_it_is_certified_or_names_nodes_and_their_times_are_then_accepted(job: Job):
    dwell_s = job.dwell_s
    rounds = 40 + job.path.segments
    for _ in range(rounds):
        try:
            scheduled = schedule(job.path, dwell_s, job.machine, job.corridor_mm)
        except LimitsError as error:
            named = [(int(node), float(more)) for node, more in NAMED.findall(error.message)]
            assert named
            dwell_s = dwell_s.copy()
            for node, more_s in named:
                # Four decimals are printed.
                dwell_s[node - 1] += more_s + 1e-4
            continue
        check(scheduled, job)
        np.testing.assert_allclose(
            np.cumsum(scheduled.segment_time_s), np.cumsum(dwell_s), atol=job.machine.sample_period_s * (1 + 1e-6)
        )
        return
    pytest.fail(f"still refused after {rounds} rounds of doing as told")


@settings(max_examples=60)
@given(jobs(coarsest_counts_per_mm=10_000.0))
def test_the_shortest_times_are_accepted_as_they_are(job: Job):
    times_s = shortest_times(job.path, job.machine)
    # Longer segments are cut into pieces of even speed, which needs more time beside a stop.
    assume(times_s.max() <= MAX_SEGMENT_SAMPLES * job.machine.sample_period_s)
    check(schedule(job.path, times_s, job.machine, job.corridor_mm), job)


@pytest.mark.parametrize("direction", [(1, 1), (-1, 1), (-1, -1)])
@pytest.mark.parametrize("letters", ["AB", "BA", "HD"])
def test_a_program_is_the_same_motion_on_part_whatever_the_axes_are_called_and_count(direction, letters):
    path = ToolPath(np.array([0.0, 1.0, 2.0, 2.0, 1.0, -1.0]), np.array([0.0, 0.0, 0.0, 1.0, 1.5, 1.5]))
    dwell_s = np.array([0.1, 0.2, 0.3, 0.2, 0.4])
    plain, turned = make_machine(), make_machine(direction=direction, letters=letters)
    expected = schedule(path, dwell_s, plain, CORRIDOR_MM).program
    program = schedule(path, dwell_s, turned, CORRIDOR_MM).program
    for index, coordinate in enumerate("xy"):
        assert program.coordinates[coordinate] == letters[index]
        one, other = expected.axis_of(coordinate), program.axis_of(coordinate)
        sign = direction[index]
        assert other.start_counts == sign * one.start_counts
        assert other.increment_counts.tolist() == (sign * one.increment_counts).tolist()
        assert other.end_velocity_counts_s.tolist() == (sign * one.end_velocity_counts_s).tolist()


@settings(max_examples=30)
@given(jobs())
def test_scheduling_the_same_job_twice_gives_the_same_integers(job: Job):
    one, other = (schedule(job.path, job.dwell_s, job.machine, job.corridor_mm, stretch=True) for _ in range(2))
    assert one.program.time_samples.tolist() == other.program.time_samples.tolist()
    for letter, axis in one.program.axes.items():
        assert axis.end_velocity_counts_s.tolist() == other.program.axes[letter].end_velocity_counts_s.tolist()


@settings(max_examples=40)
@given(jobs(max_nodes=60))
def test_certified_anew_a_stretched_program_still_passes(job: Job):
    scheduled = schedule(job.path, job.dwell_s, job.machine, job.corridor_mm, stretch=True)
    again = certify(
        scheduled.program,
        job.machine,
        job.path,
        scheduled.segment_time_s,
        scheduled.source_segment,
        job.corridor_mm,
    )
    assert again.passed
