"""Several tools on one part: composition, certificates, order, replanning, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ibfctl.dwell.deposition import grid_of
from ibfctl.dwell.motion import executed_removal
from ibfctl.errors import CancelledError, InputError, LimitsError
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.options import Aim, PlanOptions
from ibfctl.planning.planner import make_plan
from ibfctl.planning.sequence import PlanSequence
from ibfctl.planning.several import plan_sequence, replan_later
from ibfctl.planning.tool import Tool, usual_interval_mm
from ibfctl.surface.influence import gaussian
from ibfctl.surface.levelling import Levelling, rms
from ibfctl.surface.map import SurfaceMap

MACHINE = read_machine(shipped_machine("simulator"))


def surface() -> SurfaceMap:
    y, x = np.mgrid[-1:1:40j, -1:1:56j]
    return SurfaceMap.centred(30 * (x**2 + 0.6 * y**2) + 2 * np.cos(9 * x + 1) * np.cos(7 * y), 0.25)


def tool(fwhm_mm: float, interval_mm: float, aim: Aim | None = None, **choices: object) -> Tool:
    options = PlanOptions(pitch_mm=interval_mm, step_mm=interval_mm, aim=aim or Aim(0.02), **choices)  # type: ignore[arg-type]
    return Tool(gaussian(fwhm_mm, 12.0, 1.2 * fwhm_mm, 0.25), MACHINE, options)


SMALL, LARGE = tool(2.0, 1.0), tool(4.0, 2.0)


@pytest.fixture(scope="module")
def planned() -> PlanSequence:
    return plan_sequence(surface(), [SMALL, LARGE], tool_change_s=30.0)


def test_the_widest_tool_runs_first_and_each_is_certified(planned: PlanSequence) -> None:
    assert [plan.influence for plan in planned.plans] == [LARGE.influence, SMALL.influence]
    assert all(plan.certificate.passed for plan in planned.plans)
    for plan in planned.plans:
        assert plan.machine is MACHINE


def test_each_plan_starts_from_what_the_one_before_leaves(planned: PlanSequence) -> None:
    first, second = planned.plans
    assert first.surface is not None
    assert second.surface is not None
    assert first.prediction is not None
    assert second.prediction is not None
    np.testing.assert_array_equal(first.surface.height_nm, planned.surface.height_nm)
    left_nm = first.surface.height_nm - first.prediction.executed_removal_nm
    np.testing.assert_allclose(second.surface.height_nm, left_nm, atol=1e-9)
    np.testing.assert_allclose(second.prediction.initial_nm, first.prediction.executed_residual_nm, atol=1e-9)
    np.testing.assert_allclose(
        planned.prediction.executed_residual_nm, second.prediction.executed_residual_nm, atol=1e-9
    )


def test_the_prediction_is_that_of_the_programs_integers(planned: PlanSequence) -> None:
    grid = grid_of(planned.surface)
    removal_nm = sum(executed_removal(plan.program, grid, plan.influence) for plan in planned.plans)  # type: ignore[arg-type]
    np.testing.assert_allclose(planned.prediction.executed_removal_nm, removal_nm, atol=1e-9)
    mask = planned.prediction.clear_aperture
    residual_nm = Levelling.over(mask, "tilt")((planned.surface.height_nm - removal_nm)[mask])
    assert planned.summary()["executed_rms_nm"] == pytest.approx(rms(residual_nm), rel=1e-9)


def test_together_they_beat_each_alone(planned: PlanSequence) -> None:
    alone = {
        name: make_plan(surface(), each.influence, MACHINE, each.options).summary()
        for name, each in (("large", LARGE), ("small", SMALL))
    }
    figures = planned.summary()
    assert figures["executed_rms_nm"] < 0.5 * alone["large"]["executed_rms_nm"]  # type: ignore[operator]
    assert figures["beam_time_s"] < 0.9 * alone["small"]["total_time_s"]  # type: ignore[operator]
    assert figures["total_time_s"] == pytest.approx(planned.beam_time_s + 30.0)


def test_motion_in_the_loop_goes_tool_by_tool_and_never_back(planned: PlanSequence) -> None:
    rounds = planned.rounds
    assert len(rounds) >= 4
    assert all(after.rms_nm <= before.rms_nm + 1e-9 for before, after in pairwise(rounds))
    assert rounds[-1].rms_nm == pytest.approx(planned.summary()["executed_rms_nm"], rel=1e-9)
    assert rounds[-1].total_time_s == pytest.approx(planned.beam_time_s)
    plain = plan_sequence(
        surface(), [replace(each, options=replace(each.options, loop=False)) for each in (SMALL, LARGE)]
    )
    assert plain.rounds == ()
    assert plain.summary()["executed_rms_nm"] == pytest.approx(rounds[0].rms_nm, rel=1e-6)


def test_the_summary_has_a_plans_keys_and_each_tools(planned: PlanSequence) -> None:
    figures = planned.summary()
    assert set(make_plan(surface(), LARGE.influence, MACHINE, LARGE.options).summary()) <= set(figures)
    assert figures["segments"] == sum(len(plan.program) for plan in planned.plans)
    tools = figures["tools"]
    assert [each["pitch_mm"] for each in tools] == [2.0, 1.0]  # type: ignore[attr-defined]
    assert all(each["certificate"]["passed"] for each in tools)  # type: ignore[attr-defined]
    assert figures["certificate"]["passed"]  # type: ignore[index]


@pytest.mark.parametrize("method", ["mto", "sto"])
def test_the_papers_methods_are_planned_and_certified_too(planned: PlanSequence, method: str) -> None:
    peer = plan_sequence(surface(), [SMALL, LARGE], method=method)  # type: ignore[arg-type]
    assert peer.method == method
    assert peer.rounds == ()
    assert all(plan.certificate.passed for plan in peer.plans)
    assert peer.summary()["ideal_rms_nm"] < 0.2 * peer.summary()["initial_rms_nm"]  # type: ignore[operator]
    assert peer.beam_time_s > planned.beam_time_s


def test_a_limit_on_time_includes_the_changes_of_tools(planned: PlanSequence) -> None:
    most_s = planned.total_time_s
    aim = Aim(max_time_s=most_s)
    limited = plan_sequence(surface(), [tool(2.0, 1.0, aim), tool(4.0, 2.0, aim)], tool_change_s=60.0)
    assert limited.total_time_s <= 1.01 * most_s
    assert limited.beam_time_s < planned.beam_time_s
    with pytest.raises(LimitsError, match="changes of tools"):
        plan_sequence(surface(), [tool(2.0, 1.0, aim), tool(4.0, 2.0, aim)], tool_change_s=most_s)


def test_a_residual_out_of_reach_is_refused() -> None:
    aim = Aim(max_residual_nm=1e-4)
    with pytest.raises(LimitsError, match="narrower tool"):
        plan_sequence(surface(), [tool(2.0, 1.0, aim), tool(4.0, 2.0, aim)])


def test_an_extra_depth_goes_everywhere() -> None:
    deep = plan_sequence(surface(), [tool(2.0, 1.0, extra_removal_nm=5.0), tool(4.0, 2.0, extra_removal_nm=5.0)])
    removal_nm = deep.prediction.executed_removal_nm[deep.prediction.clear_aperture]
    assert removal_nm.min() > 4.0
    assert deep.summary()["executed_rms_nm"] < 1.0  # type: ignore[operator]


def test_later_tools_are_planned_anew_from_what_was_really_removed(planned: PlanSequence) -> None:
    first = planned.plans[0]
    assert first.prediction is not None
    really_nm = 0.93 * first.prediction.executed_removal_nm
    missed = (
        surface().height_nm
        - really_nm
        - (planned.prediction.executed_removal_nm - first.prediction.executed_removal_nm)
    )
    level = Levelling.over(planned.prediction.clear_aperture, "tilt")
    blind_nm = rms(level(missed[planned.prediction.clear_aperture]))
    anew = replan_later(planned, 1, really_nm)
    assert [plan.influence for plan in anew.plans] == [SMALL.influence]
    assert anew.summary()["executed_rms_nm"] < 0.3 * blind_nm  # type: ignore[operator]
    assert anew.tool_change_s == 30.0
    np.testing.assert_allclose(anew.surface.height_nm, surface().height_nm - really_nm)


def test_replanning_knows_what_is_left_of_the_time(planned: PlanSequence) -> None:
    aim = Aim(max_time_s=planned.total_time_s)
    limited = plan_sequence(surface(), [tool(2.0, 1.0, aim), tool(4.0, 2.0, aim)], tool_change_s=5.0)
    first = limited.plans[0]
    assert first.prediction is not None
    anew = replan_later(limited, 1, first.prediction.executed_removal_nm)
    spent_s = first.program.total_time_s + 5.0
    assert anew.plans[0].options.aim.max_time_s == pytest.approx(planned.total_time_s - spent_s)
    assert spent_s + anew.total_time_s <= 1.01 * planned.total_time_s


@pytest.mark.parametrize("done", [-1, 0, 2])
def test_replanning_needs_a_tool_before_and_a_tool_after(planned: PlanSequence, done: int) -> None:
    with pytest.raises(InputError, match="replan"):
        replan_later(planned, done, planned.prediction.executed_removal_nm)


def test_replanning_needs_a_removal_of_the_whole_aperture(planned: PlanSequence) -> None:
    holed = planned.prediction.executed_removal_nm.copy()
    holed[3, 3] = np.nan
    for bad in (holed, np.zeros((3, 3))):
        with pytest.raises(InputError, match="does not cover"):
            replan_later(planned, 1, bad)


def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="no tool"):
        plan_sequence(surface(), [])
    with pytest.raises(InputError, match="tool change"):
        plan_sequence(surface(), [SMALL], tool_change_s=-1.0)


def test_planning_can_be_cancelled() -> None:
    for allowed in (0, 3, 40):
        asked = iter(range(10_000))
        with pytest.raises(CancelledError):
            plan_sequence(
                surface(), [SMALL, LARGE], cancelled=lambda asked=asked, allowed=allowed: next(asked) >= allowed
            )  # type: ignore[misc]


def test_the_usual_interval_is_the_papers() -> None:
    # Ke et al. 2022, section 5: 12, 8 and 5 mm give 2.10, 1.40 and 0.87 mm.
    for diameter_mm, interval_mm in ((12.0, 2.10), (8.0, 1.40), (5.0, 0.87)):
        influence = gaussian(0.4 * diameter_mm, 1.0, 0.5 * diameter_mm, 0.1)
        assert usual_interval_mm(influence) == pytest.approx(interval_mm, abs=0.01)
