"""Ramps and cuts of random programs: on the path, within the limits, exact to the integer where they join."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.programs import SAMPLE_S, machine

from ibfctl.machine.program import PvtProgram
from ibfctl.path.tool_path import ToolPath
from ibfctl.runs.limits import keeps_limits, position_range
from ibfctl.runs.nodes import Nodes
from ibfctl.runs.seam import cut, ramp_down, run_in
from ibfctl.schedule.hermite import Cubics
from ibfctl.schedule.scheduler import schedule

BENCH = machine()


@st.composite
def programs(draw: st.DrawFn) -> PvtProgram:
    """Programs of the scheduler itself, near the machine's limits in places, dwelling in others."""
    count = draw(st.integers(6, 40))
    seed = draw(st.integers(0, 2**32 - 1))
    random = np.random.default_rng(seed)
    turn = np.cumsum(random.normal(0, draw(st.sampled_from([0.05, 0.5])), count))
    step_mm = random.uniform(0.2, 4.0, count)
    x_mm, y_mm = (np.concatenate([[0.0], np.cumsum(step_mm * way(turn))]) for way in (np.cos, np.sin))
    dwell_s = random.exponential(draw(st.sampled_from([0.02, 0.2])), count) + 0.02
    path = ToolPath(np.clip(x_mm, -90, 90), np.clip(y_mm, -45, 45))
    return schedule(path, dwell_s, BENCH, 0.05, stretch=True).program


def limits_kept(program: PvtProgram) -> bool:
    return keeps_limits(Nodes.of(program).cubics(SAMPLE_S), BENCH)


def distance_from_path_counts(program: PvtProgram, of: PvtProgram) -> float:
    """Greatest distance of a program's positions from the nearest position of another."""

    def positions(job: PvtProgram, every: float) -> np.ndarray:
        nodes = Nodes.of(job)
        at, _ = nodes.state_at(np.arange(0, nodes.sample[-1] + every, every), SAMPLE_S)
        return np.stack([at["A"], at["B"]], axis=1)

    from scipy.spatial import cKDTree

    tree = cKDTree(positions(of, 0.05))
    return float(tree.query(positions(program, 8.0))[0].max())


@settings(max_examples=40, deadline=None)
@given(programs(), st.floats(0, 1))
def test_a_run_in_leads_along_the_path_into_the_plan(program: PvtProgram, share: float) -> None:
    nodes = Nodes.of(program)
    total = int(nodes.sample[-1])
    wanted = round(share * total)
    way = run_in(program, wanted, BENCH)
    made = Nodes.of(way.program)
    lead = int(made.sample[way.open_at])
    assert limits_kept(way.program)
    assert way.plan_sample % 2 == 0
    assert abs(way.plan_sample - wanted) <= 64
    assert made.sample[-1] - lead == total - way.plan_sample
    assert set(np.diff(made.sample) % 2) == {0}
    assert np.diff(made.sample).max() <= 2048
    state, planned = made.state_at(np.array([lead]), SAMPLE_S), nodes.state_at(np.array([way.plan_sample]), SAMPLE_S)
    for letter in "AB":
        assert abs(state[0][letter][0] - planned[0][letter][0]) <= 0.5 + 1e-6
        assert abs(state[1][letter][0] - planned[1][letter][0]) <= 0.5 + 1e-6
        behind = nodes.sample > way.plan_sample
        tail = slice(made.sample.size - int(behind.sum()), None)
        assert np.array_equal(made.position_counts[letter][tail], nodes.position_counts[letter][behind])
        assert np.array_equal(made.velocity_counts_s[letter][tail], nodes.velocity_counts_s[letter][behind])


@settings(max_examples=40, deadline=None)
@given(programs(), st.floats(0, 1))
def test_a_ramp_down_comes_to_rest_on_the_path(program: PvtProgram, share: float) -> None:
    segment = round(share * len(program))
    way = ramp_down(program, segment, BENCH)
    made = Nodes.of(way.program)
    assert way.leave_at >= segment
    assert limits_kept(way.program)
    assert all(velocity[-1] == 0 for velocity in made.velocity_counts_s.values())
    kept = Nodes.of(program).part(0, way.leave_at)
    for letter in "AB":
        assert np.array_equal(made.position_counts[letter][: way.leave_at + 1], kept.position_counts[letter])
        assert np.array_equal(made.velocity_counts_s[letter][: way.leave_at + 1], kept.velocity_counts_s[letter])


@settings(max_examples=10, deadline=None)
@given(programs(), st.floats(0, 1))
def test_ramps_stay_on_the_path(program: PvtProgram, share: float) -> None:
    total = int(program.time_samples.sum())
    for made in (
        run_in(program, round(share * total), BENCH).program,
        ramp_down(program, round(share * len(program)), BENCH).program,
    ):
        assert distance_from_path_counts(made, program) < 25  # counts of 1 µm


@settings(max_examples=40, deadline=None)
@given(programs(), st.floats(0, 1))
def test_a_cut_changes_neither_ends_nor_times(program: PvtProgram, share: float) -> None:
    nodes = Nodes.of(program)
    sample = 2 * round(share * int(nodes.sample[-1]) / 2)
    made, place = cut(program, sample)
    after = Nodes.of(made)
    assert after.sample[place] == sample
    kept = np.isin(after.sample, nodes.sample)
    for letter in "AB":
        assert np.array_equal(after.position_counts[letter][kept], nodes.position_counts[letter])
        assert np.array_equal(after.velocity_counts_s[letter][kept], nodes.velocity_counts_s[letter])
        exact, _ = nodes.state_at(np.array([float(sample)]), SAMPLE_S)
        assert abs(after.position_counts[letter][place] - exact[letter][0]) <= 0.5 + 1e-6


@settings(max_examples=200, deadline=None)
@given(
    st.integers(-1000, 1000), st.integers(-5000, 5000), st.integers(-5000, 5000), st.integers(1, 1024)
)
def test_the_extremes_of_a_cubic_are_those_of_its_samples(move: int, v0: int, v1: int, samples: int) -> None:
    time_s = samples * 2 * SAMPLE_S
    cubic = Cubics(*(np.array([float(value)]) for value in (7, move, v0, v1, time_s)))
    seen = cubic.position(np.linspace(0, time_s, 2001)[None, :])
    low, high = position_range(cubic)
    assert low <= seen.min() + 1e-9
    assert high >= seen.max() - 1e-9
    assert low == pytest.approx(seen.min(), abs=1e-2)
    assert high == pytest.approx(seen.max(), abs=1e-2)
