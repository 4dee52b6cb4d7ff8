"""The residual along a plan begins at the map's own error and ends at what the plan predicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.small_job import small_height_nm

from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.along import residual_along
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import Plan
from ibfctl.planning.planner import make_plan
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import SurfaceMap


@pytest.fixture(scope="module")
def plan() -> Plan:
    surface = SurfaceMap(small_height_nm(), 0.25, -6.0, -4.0)
    options = PlanOptions(pitch_mm=1.0, step_mm=1.0, loop=False)
    return make_plan(surface, gaussian(1.6, 4.0, 2.0, 0.25), read_machine(shipped_machine("simulator")), options)


def test_it_leads_from_the_initial_to_the_executed_residual(plan: Plan) -> None:
    along = residual_along(plan)
    assert along is not None
    figures = plan.summary()
    assert along.at(0) == pytest.approx(figures["initial_rms_nm"])
    assert along.at(plan.program.time_samples.sum()) == pytest.approx(figures["executed_rms_nm"], rel=1e-6)
    assert along.plan_sample[0] == 0
    assert along.plan_sample[-1] == plan.program.time_samples.sum()
    assert np.all(np.diff(along.plan_sample) > 0)


def test_a_checkpoint_is_the_residual_of_the_program_up_to_there(plan: Plan) -> None:
    fine, coarse = residual_along(plan, 40), residual_along(plan, 8)
    assert fine is not None
    assert coarse is not None
    same = np.isin(fine.plan_sample, coarse.plan_sample)
    assert same.sum() >= 2
    assert np.interp(fine.plan_sample[same], coarse.plan_sample, coarse.rms_nm) == pytest.approx(fine.rms_nm[same])


def test_a_mere_schedule_has_no_residual(plan: Plan) -> None:
    assert residual_along(replace(plan, surface=None)) is None
