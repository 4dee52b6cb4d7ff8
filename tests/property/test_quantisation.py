"""Rounding to counts and samples: nothing accumulates, whatever the times."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.machine.program import MAX_SEGMENT_SAMPLES
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.counting import count_path, even_samples
from ibfctl.schedule.scheduler import shortest_times
from tests.property.timed_paths import PERIODS_S, Job, jobs, make_machine

TIMES_S = st.lists(
    st.one_of(
        st.just(0.0), st.floats(0.0, 1e-6), st.floats(1e-4, 1e-2), st.floats(0.01, 5.0), st.floats(100.0, 1e5)
    ),
    min_size=1,
    max_size=60,
)


@given(TIMES_S, st.sampled_from(PERIODS_S))
def test_running_sums_of_even_samples_stay_within_a_sample_of_the_times(times, period_s):
    samples = even_samples(np.array(times), period_s)
    assert (samples % 2 == 0).all()
    assert (samples >= 0).all()
    exact, counted = Fraction(0), 0
    for time_s, count in zip(times, samples.tolist(), strict=True):
        exact, counted = exact + Fraction(time_s), counted + count
        # One sample for rounding to pairs; the last bits of a running sum of doubles on top.
        assert abs(counted - exact / Fraction(period_s)) <= 1 + Fraction(exact / Fraction(period_s)) / 10**14


@given(st.lists(st.integers(1, 500), min_size=2, max_size=60), st.integers(0, 2000), st.integers(1, 7))
def test_whole_pairs_of_samples_keep_their_pairs_wherever_they_start(pairs, shift, odd):
    times = np.concatenate([[(2 * shift + odd) / 1024], 2 * np.array(pairs) / 1024])
    assert even_samples(times, 1 / 1024)[1:].tolist() == [2 * count for count in pairs]


@settings(max_examples=60)
@given(jobs())
def test_shortest_times_survive_rounding_behind_any_start(job: Job):
    shortest_s = shortest_times(job.path, job.machine)
    period_s = job.machine.sample_period_s
    for start_s in (0.0, 0.5 * period_s, period_s, 1.37 * period_s):
        samples = even_samples(np.concatenate([[start_s], shortest_s]), period_s)[1:]
        assert (samples >= np.rint(shortest_s / period_s)).all()


@settings(max_examples=80)
@given(jobs(), st.integers(0, 1000))
def test_counted_positions_are_the_nodes_to_half_a_count(job: Job, seed: int):
    samples = 2 * np.random.default_rng(seed).integers(1, 5000, size=job.path.segments)
    counted = count_path(job.path, samples, job.machine)
    assert np.bincount(counted.source_segment, counted.time_samples).tolist() == samples.tolist()
    assert (counted.time_samples % 2 == 0).all()
    assert counted.time_samples.max() <= MAX_SEGMENT_SAMPLES
    last_pieces = np.flatnonzero(np.diff(counted.source_segment, append=-1))
    for coordinate, node_mm in (("x", job.path.x_mm), ("y", job.path.y_mm)):
        axis, letter = job.machine.axis_of(coordinate), job.machine.letter_of(coordinate)
        at_nodes = counted.position_counts[letter][np.concatenate([[0], last_pieces + 1])]
        assert np.abs(at_nodes - node_mm * axis.signed_counts_per_mm).max() <= 0.5 + 1e-6


@given(st.integers(MAX_SEGMENT_SAMPLES // 2 + 1, 100_000), st.floats(-90, 90), st.floats(-90, 90))
def test_a_long_dwell_is_split_on_the_same_straight_line_at_the_same_speed(pairs, x_mm, y_mm):
    machine = make_machine()
    counted = count_path(ToolPath(np.array([1.0, x_mm]), np.array([-2.0, y_mm])), np.array([2 * pairs]), machine)
    pieces = counted.time_samples.size
    assert pieces == -(-2 * pairs // MAX_SEGMENT_SAMPLES)
    assert (counted.source_segment == 0).all()
    assert np.ptp(counted.time_samples) <= 2
    share = np.concatenate([[0], np.cumsum(counted.time_samples)]) / (2 * pairs)
    for coordinate, begin, end in (("x", 1.0, x_mm), ("y", -2.0, y_mm)):
        scale = machine.axis_of(coordinate).signed_counts_per_mm
        straight = (begin + share * (end - begin)) * scale
        assert np.abs(counted.position_counts[machine.letter_of(coordinate)] - straight).max() <= 0.5 + 1e-6
