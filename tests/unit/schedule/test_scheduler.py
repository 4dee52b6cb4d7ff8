"""Scheduling: smooth where nothing forbids it, refused with names where the limits do, never trusting the solver."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import osqp
import pytest

from ibfctl.errors import InputError, LimitsError
from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.path.raster import raster
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.certificate import axis_cubics
from ibfctl.schedule.scheduler import PvtSchedule, schedule, shortest_times
from ibfctl.surface.map import Rectangle

CORRIDOR_MM = 0.025


@pytest.fixture(scope="module")
def machine() -> MachineDescription:
    return read_machine(shipped_machine("simulator"))


def path_of(*nodes: tuple[float, float]) -> ToolPath:
    return ToolPath(*(np.array(values, dtype=float) for values in zip(*nodes, strict=True)))


def test_a_single_segment_goes_from_rest_to_rest(machine: MachineDescription) -> None:
    program = schedule(path_of((0, 0), (3, -4)), np.array([1.0]), machine, CORRIDOR_MM).program
    assert program.time_samples.tolist() == [1024]
    for axis, move in ((program.axes["A"], 30_000), (program.axes["B"], -40_000)):
        assert axis.increment_counts.tolist() == [move]
        assert axis.end_velocity_counts_s.tolist() == [0]


def test_an_even_line_runs_evenly(machine: MachineDescription) -> None:
    path = path_of(*((0.5 * node, 0.0) for node in range(41)))
    program = schedule(path, np.full(40, 0.125), machine, CORRIDOR_MM).program
    speed = program.axes["A"].end_velocity_counts_s[5:-6] / 10_000
    np.testing.assert_allclose(speed, 4.0, atol=0.01)


def test_smooth_times_make_a_spline_without_acceleration_jumps(machine: MachineDescription) -> None:
    path = path_of(*((0.5 * node, 0.0) for node in range(81)))
    dwell_s = 0.25 + 0.1 * np.sin(np.arange(80) / 5)
    program = schedule(path, dwell_s, machine, CORRIDOR_MM).program
    cubics = axis_cubics(program, program.axes["A"])
    # Start and stop are jumps that die out over some nodes.
    inner = slice(15, -15)
    assert np.abs(cubics.acceleration_jumps[inner]).max() < 0.01 * cubics.peak_acceleration[inner].max()


def test_an_axis_that_should_stand_does(machine: MachineDescription) -> None:
    path = raster(Rectangle(0, 6, 0, 3), 0.5, 0.5)
    dwell_s = 0.06 + 0.2 * np.random.default_rng(1).uniform(size=path.segments)
    program = schedule(path, dwell_s, machine, CORRIDOR_MM, stretch=True).program
    for axis in program.axes.values():
        standing = axis.increment_counts == 0
        assert standing.any()
        assert (axis.end_velocity_counts_s[standing] == 0).all()
        assert (axis.end_velocity_counts_s[:-1][standing[1:]] == 0).all()


def test_a_long_dwell_on_one_spot_is_a_wait(machine: MachineDescription) -> None:
    program = schedule(path_of((0, 0), (1, 0), (1, 0), (2, 0)), np.array([0.5, 7.0, 0.5]), machine, 0.1).program
    waiting = (program.axes["A"].increment_counts == 0) & (program.axes["B"].increment_counts == 0)
    assert program.time_samples[waiting].sum() == 7 * 1024
    assert program.time_samples.max() <= 2048
    assert len(program) == 6


def test_a_long_segment_is_cut_into_pieces_that_do_not_stop(machine: MachineDescription) -> None:
    program = schedule(path_of((0, 0), (10, 5)), np.array([10.0]), machine, CORRIDOR_MM).program
    assert program.time_samples.tolist() == [2048] * 5
    assert (program.axes["A"].end_velocity_counts_s[:-1] > 5000).all()
    assert program.axes["A"].end_counts == 100_000


def test_a_segment_that_the_limits_lengthen_beyond_2048_samples_is_cut_too() -> None:
    slow = read_machine(shipped_machine("simulator"))
    axis = slow.axes["A"].model_copy(update={"a_max_mm_s2": 1.0})
    slow = slow.model_copy(update={"axes": {**slow.axes, "A": axis}})
    scheduled = schedule(path_of((0, 0), (1, 0), (0, 0)), np.array([1.99, 1.99]), slow, CORRIDOR_MM, stretch=True)
    assert scheduled.certificate.passed
    assert len(scheduled.program) == 4
    # From rest to rest over s in time h takes 6 s/h².
    assert scheduled.segment_time_s == pytest.approx([np.sqrt(6), np.sqrt(6)], abs=0.01)


def test_times_that_are_too_short_are_refused_with_the_nodes_that_need_more(machine: MachineDescription) -> None:
    path = path_of((0, 0), (10, 0), (20, 0), (20, 5), (30, 5))
    with pytest.raises(LimitsError, match=r"2 nodes need more, the worst: node 3 \(20\.000, 5\.000 mm\) \+") as caught:
        schedule(path, np.array([0.5, 0.5, 0.002, 0.1]), machine, CORRIDOR_MM)
    assert "node 4 (30.000, 5.000 mm) +" in caught.value.message
    assert "node 1" not in caught.value.message
    assert "\n" not in str(caught.value)


def test_the_lengthening_is_no_longer_than_the_closed_form_asks(machine: MachineDescription) -> None:
    path = path_of((0, 0), (10, 0), (0, 0))
    scheduled = schedule(path, np.array([0.01, 0.01]), machine, CORRIDOR_MM, stretch=True)
    assert scheduled.segment_time_s == pytest.approx([np.sqrt(6 * 10 / 2000)] * 2, rel=0.02)


def test_a_node_outside_the_travel_is_refused_by_name(machine: MachineDescription) -> None:
    with pytest.raises(LimitsError, match=r"travel of axis B: node 1 at y = 61\.000 mm"):
        schedule(path_of((0, 0), (0, 61), (0, 0)), np.array([5.0, 5.0]), machine, CORRIDOR_MM)


def test_a_node_on_the_very_end_of_a_travel_between_two_counts_is_allowed() -> None:
    machine = read_machine(shipped_machine("simulator"))
    update = {"counts_per_mm": 49.3, "travel_min_mm": -7.7, "travel_max_mm": 7.7}
    machine = machine.model_copy(update={"axes": {k: v.model_copy(update=update) for k, v in machine.axes.items()}})
    scheduled = schedule(path_of((-7.7, 0), (7.7, 0)), np.array([1.0]), machine, CORRIDOR_MM)
    assert scheduled.certificate.passed


@pytest.mark.parametrize("bad_s", [-0.001, float("nan"), float("inf"), 1e300])
def test_a_dwell_time_that_is_no_time_is_refused_by_node(machine: MachineDescription, bad_s: float) -> None:
    with pytest.raises(LimitsError, match="node 2"):
        schedule(path_of((0, 0), (1, 0), (2, 0)), np.array([0.5, bad_s]), machine, CORRIDOR_MM)


def test_dwell_times_that_would_fill_the_memory_are_refused(machine: MachineDescription) -> None:
    with pytest.raises(LimitsError, match="segments"):
        schedule(path_of(*((k, 0) for k in range(100))), np.full(99, 1e6), machine, CORRIDOR_MM)


def test_one_time_per_segment_is_wanted(machine: MachineDescription) -> None:
    with pytest.raises(InputError, match="1 segments but 2 times"):
        schedule(path_of((0, 0), (1, 0)), np.array([0.5, 0.5]), machine, CORRIDOR_MM)


def test_repeated_nodes_of_no_time_at_the_end_are_certified_or_named(machine: MachineDescription) -> None:
    path, dwell_s = path_of((0, 0), (1, 0), (1, 0), (1, 0), (1, 0), (1, 0)), np.array([1.0, 0, 0, 0, 0])
    assert schedule(path, dwell_s, machine, CORRIDOR_MM, stretch=True).certificate.passed
    with pytest.raises(LimitsError, match="node"):
        schedule(path, dwell_s, machine, CORRIDOR_MM)


def test_times_in_odd_samples_lose_no_pair_behind_each_other(machine: MachineDescription) -> None:
    path = path_of(*((0.5 * node, 0.0) for node in range(20)))
    dwell_s = shortest_times(path, machine)
    dwell_s[0] += 1 / 1024
    scheduled = schedule(path, dwell_s, machine, CORRIDOR_MM)
    assert scheduled.segment_time_s[1:].tolist() == dwell_s[1:].tolist()


@pytest.fixture
def tight(machine: MachineDescription) -> Callable[[], PvtSchedule]:
    """A job that cannot do without the programme."""
    path = raster(Rectangle(0, 6, 0, 3), 0.5, 0.5)
    dwell_s = np.random.default_rng(2).choice([0.02, 0.5], size=path.segments)
    return lambda: schedule(path, dwell_s, machine, CORRIDOR_MM, stretch=True)


@pytest.mark.parametrize(
    "answer",
    [
        lambda good: np.full_like(good, np.nan),
        lambda good: np.full_like(good, np.inf),
        lambda good: 50 * good,
        lambda good: -good,
        lambda good: good + 3.0,
        np.zeros_like,
    ],
    ids=["nan", "infinite", "much too fast", "backwards", "off", "rest"],
)
def test_a_solver_that_says_solved_and_is_not_never_makes_a_bad_program(
    tight: Callable[[], PvtSchedule], monkeypatch: pytest.MonkeyPatch, answer: Callable[[np.ndarray], np.ndarray]
) -> None:
    asked = []

    class Liar(osqp.OSQP):
        def solve(self, *arguments: object, **options: object) -> SimpleNamespace:
            honest = super().solve(*arguments, **options)
            asked.append(honest.x.size)
            return SimpleNamespace(x=answer(honest.x), info=SimpleNamespace(status_val=osqp.SolverStatus.OSQP_SOLVED))

    monkeypatch.setattr(osqp, "OSQP", Liar)
    assert tight().certificate.passed
    assert sum(asked) > 0
