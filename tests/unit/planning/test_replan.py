"""An interrupted run, planned on: the finished part is as good as was promised."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from ibfctl.dwell.deposition import grid_of
from ibfctl.dwell.operator import removal_of_samples
from ibfctl.dwell.solver import never
from ibfctl.dwell.trade_off import Aim
from ibfctl.errors import InputError
from ibfctl.machine.description import read_machine
from ibfctl.machine.placement import Placement
from ibfctl.machine.shipped import shipped_machine
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.job import prepare
from ibfctl.planning.loop import executed
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.pairs import corrected_around
from ibfctl.planning.plan import Plan
from ibfctl.planning.planner import make_plan, schedule_nodes
from ibfctl.planning.replan import removal_of_intervals, replan
from ibfctl.planning.restart import node_samples, places, restart
from ibfctl.surface.influence import gaussian
from ibfctl.surface.levelling import Levelling, rms
from ibfctl.surface.map import SurfaceMap
from tests.support.small_job import small_height_nm

COARSE = PlanOptions(pitch_mm=1.0, step_mm=1.0)
CORRIDOR_MM = 0.05


def planned(options: PlanOptions) -> Plan:
    surface, tool = SurfaceMap.centred(small_height_nm(), 0.25), gaussian(1.6, 4.0, 2.0, 0.1)
    return make_plan(surface, tool, read_machine(shipped_machine("simulator")), options)


@pytest.fixture(scope="module")
def plan() -> Plan:
    return planned(COARSE)


@pytest.fixture(scope="module")
def maze() -> Plan:
    return planned(PlanOptions(path="maze", pitch_mm=1.0))


@pytest.fixture(scope="module")
def hasty() -> Plan:
    return planned(replace(COARSE, aim=Aim(max_time_s=60.0)))


def final_rms_nm(plan: Plan) -> float:
    assert plan.prediction is not None
    return rms(plan.prediction.executed_residual_nm[plan.prediction.clear_aperture])


def total(plan: Plan) -> int:
    return int(plan.program.time_samples.sum())


def test_intervals_add_up_to_the_whole_removal(plan: Plan) -> None:
    assert plan.prediction is not None
    cuts = [0, 1, 5000, 5001, 60_000, total(plan)]
    parts = [removal_of_intervals(plan, [interval]) for interval in itertools.pairwise(cuts)]
    whole = removal_of_intervals(plan, [(0, total(plan))])
    assert np.allclose(whole, plan.prediction.executed_removal_nm, atol=1e-9)
    assert np.allclose(sum(parts), whole, atol=1e-3)  # Gauss points elsewhere
    some = removal_of_intervals(plan, [(0, 5000), (60_000, total(plan))])
    assert np.allclose(some, parts[0] + parts[1] + parts[4], atol=1e-3)
    assert not removal_of_intervals(plan, []).any()
    assert not removal_of_intervals(plan, [(77, 77)]).any()


@pytest.fixture(scope="module")
def placed() -> Plan:
    return planned(replace(COARSE, placement=Placement(20.0, -7.0, 30.0, mirrored=True)))


@pytest.fixture(scope="module")
def fast() -> Plan:
    """So fast that a dozen pairs of samples are a segment's time, and with so little left that a seam shows."""
    y, x = np.mgrid[-1:1:32j, -1:1:40j]
    surface, tool = SurfaceMap.centred(5 * (x**2 + 0.7 * y**2), 0.25), gaussian(3.0, 10.0, 4.0, 0.1)
    return make_plan(
        surface, tool, read_machine(shipped_machine("simulator")), PlanOptions(pitch_mm=0.5, step_mm=0.5)
    )


@pytest.mark.parametrize(("job", "count"), [("plan", 3), ("maze", 3), ("hasty", 3), ("placed", 3), ("fast", 1)])
def test_wherever_it_is_interrupted_the_promise_is_kept_within_5_percent(
    job: str, count: int, request: pytest.FixtureRequest
) -> None:
    plan: Plan = request.getfixturevalue(job)
    seams = np.random.default_rng(4).integers(1, total(plan) - 200, count)
    for seam in [*seams.tolist(), 1]:
        rest = replan(plan, removal_of_intervals(plan, [(0, seam)]), seam)
        assert rest.certificate.passed
        assert final_rms_nm(rest) <= 1.05 * final_rms_nm(plan), seam
        left_s = plan.program.total_time_s - seam * plan.program.sample_period_s
        assert rest.program.total_time_s <= 1.02 * left_s + 1.5
        at_seam = places(plan.program, np.array([float(seam)]))
        for letter, axis in rest.program.axes.items():
            assert axis.start_counts == pytest.approx(at_seam[letter][0][0], abs=0.5)


def test_the_dent_of_a_seam_at_speed_is_shared_out(fast: Plan) -> None:
    assert fast.surface is not None
    assert fast.influence is not None
    assert fast.prediction is not None
    before, after = [], []
    for seam in np.random.default_rng(4).integers(1, total(fast) // 2, 5).tolist():
        path, ramped = restart(fast, seam, CORRIDOR_MM)
        assert ramped is not None
        left_nm = fast.surface.height_nm - removal_of_intervals(fast, [(0, seam)])
        surface, options = replace(fast.surface, height_nm=left_nm), replace(fast.options, path="nodes")
        job = prepare(surface, fast.influence, fast.machine, options, path, fast.prediction.clear_aperture)
        present = executed(job, ramped.segment_time_s, ramped)
        before.append(present.rms_nm)
        after.append(corrected_around(job, present, 0, final_rms_nm(fast), never).rms_nm)
    assert max(before) > 1.5 * final_rms_nm(fast)
    assert max(after) <= 1.05 * final_rms_nm(fast)


def test_what_was_really_removed_is_what_counts(plan: Plan) -> None:
    """Where the tool stood still under the beam, what follows spares the place."""
    assert plan.surface is not None
    assert plan.influence is not None
    assert plan.prediction is not None
    seam, mask = total(plan) // 2, plan.prediction.clear_aperture
    (x_mm, y_mm) = (
        places(plan.program, np.array([float(seam)]))[letter][0] / plan.program.axes[letter].counts_per_mm
        for letter in ("A", "B")
    )
    hole_nm = removal_of_samples(grid_of(plan.surface), plan.influence, x_mm, y_mm, np.array([0.5]))
    assert hole_nm.max() > 1.5
    removal_nm = hole_nm + removal_of_intervals(plan, [(0, seam)])
    rest = replan(plan, removal_nm, seam)
    blind_nm = plan.surface.height_nm - removal_nm - removal_of_intervals(plan, [(seam, total(plan))])
    assert final_rms_nm(rest) < 0.7 * rms(Levelling.over(mask, "tilt")(blind_nm[mask]))
    assert rest.surface is not None
    assert np.allclose(rest.surface.height_nm, plan.surface.height_nm - removal_nm, equal_nan=True)


@pytest.mark.parametrize("job", ["plan", "maze", "hasty", "placed"])
def test_the_rest_begins_at_rest_and_goes_on_as_planned(job: str, request: pytest.FixtureRequest) -> None:
    plan: Plan = request.getfixturevalue(job)
    for seam in np.random.default_rng(5).integers(1, total(plan) - 600, 25).tolist():
        path, made = restart(plan, seam, CORRIDOR_MM)
        assert made is not None
        assert made.certificate.passed
        assert made.segment_time_s.size == path.segments
        added = int(made.program.time_samples.sum()) - (total(plan) - seam)
        assert 0 < added < 200
        # Velocities are chosen anew around a limit that binds, up to a dozen segments either way.
        later = np.arange(seam + 600, total(plan), 997).astype(np.float64)
        expected, found = places(plan.program, later), places(made.program, later - seam + added)
        for letter, (counts, _) in expected.items():
            assert np.abs(found[letter][0] - counts).max() < 1.0


def test_long_dwells_are_nodes_of_the_path_only_once(plan: Plan) -> None:
    nodes = node_samples(plan.program, plan.path)
    assert nodes.size == plan.path.x_mm.size
    assert nodes[0] == 0
    assert nodes[-1] == total(plan)
    assert np.all(np.diff(nodes) > 0)


def test_nothing_is_left_at_the_end(plan: Plan) -> None:
    with pytest.raises(InputError, match="nothing of the path is left"):
        replan(plan, removal_of_intervals(plan, [(0, total(plan))]), total(plan))


def test_a_mere_schedule_cannot_be_planned_on(plan: Plan) -> None:
    timed = schedule_nodes(np.arange(4.0), np.zeros(4), np.array([0, 0.3, 0.3, 0.3]), plan.machine)
    with pytest.raises(InputError, match="holds no map"):
        replan(timed, np.zeros((1, 1)), 100)
    with pytest.raises(InputError, match="holds no map"):
        removal_of_intervals(timed, [(0, 100)])


def test_a_program_of_another_path_is_refused(plan: Plan) -> None:
    other = replace(plan, path=ToolPath(plan.path.x_mm + 0.5, plan.path.y_mm))
    with pytest.raises(InputError, match="path and program of the plan differ"):
        restart(other, 1000, CORRIDOR_MM)


@pytest.mark.parametrize("remove", ["tilt", "none"])
def test_a_depth_that_goes_everywhere_goes_only_once(remove: str) -> None:
    deep = planned(replace(COARSE, extra_removal_nm=30.0, remove=remove, loop=False))
    assert deep.prediction is not None
    seam = 0.4 * total(deep)
    so_far_nm = removal_of_intervals(deep, [(0, seam)])
    rest = replan(deep, so_far_nm, seam)
    assert rest.prediction is not None
    whole_nm, removed_nm = deep.prediction.executed_removal_nm, so_far_nm + rest.prediction.executed_removal_nm
    assert removed_nm.mean() == pytest.approx(whole_nm.mean(), rel=0.01)
    assert rms(removed_nm - whole_nm) < 0.01 * whole_nm.mean()
    assert final_rms_nm(rest) < 1.1 * final_rms_nm(deep)
    # And once more, from where the rest was interrupted.
    later = 0.5 * total(rest)
    second_nm = removal_of_intervals(rest, [(0, later)])
    last = replan(rest, second_nm, later)
    assert last.prediction is not None
    removed_nm = so_far_nm + second_nm + last.prediction.executed_removal_nm
    assert removed_nm.mean() == pytest.approx(whole_nm.mean(), rel=0.01)
