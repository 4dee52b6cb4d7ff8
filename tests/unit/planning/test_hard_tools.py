"""Tools that can hardly correct: nearly singular ones, weak ones, and such as remove nothing in their middle."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.machine.description import read_machine
from ibfctl.machine.program import MAX_SEGMENT_SAMPLES
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import Plan
from ibfctl.planning.planner import make_plan
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.map import SurfaceMap
from tests.support.small_job import small_height_nm

MACHINE = read_machine(shipped_machine("simulator"))
SURFACE = SurfaceMap.centred(small_height_nm(), 0.25)
Y, X = np.mgrid[-1:1:41j, -1:1:41j]
TOOLS = {
    # Four times as wide as the part is high: wherever it stands, it removes nearly the same.
    "nearly constant": gaussian(40.0, 4.0, 5.9, 0.1),
    "flat top": InfluenceFunction(np.full((41, 41), 4.0), 0.1),
    "ring": InfluenceFunction(4.0 * ((np.hypot(X, Y) > 0.8) & (np.hypot(X, Y) < 1)), 0.1),
}


def planned(tool: InfluenceFunction, path: str) -> Plan:
    return make_plan(SURFACE, tool, MACHINE, PlanOptions(path=path, pitch_mm=1.0, step_mm=1.0))  # type: ignore[arg-type]


@pytest.mark.parametrize("path", ["raster", "maze"])
@pytest.mark.parametrize("name", TOOLS)
def test_a_nearly_singular_tool_corrects_what_it_can_in_reasonable_times(name: str, path: str) -> None:
    plan = planned(TOOLS[name], path)
    figures = plan.summary()
    assert plan.certificate.passed
    assert np.isfinite(plan.dwell.time_s).all()
    assert figures["executed_rms_nm"] < 0.5 * figures["initial_rms_nm"]  # type: ignore[operator]
    # 20 nm at 4 nm/s: no time runs away along directions that the tool cannot tell apart.
    assert plan.dwell.time_s.max() < 5.0


def test_dwells_beyond_2048_samples_are_split_and_keep_their_sum() -> None:
    plan = planned(gaussian(1.6, 0.05, 2.0, 0.1), "raster")
    samples, figures = plan.program.time_samples, plan.summary()
    assert plan.dwell.time_s.max() > 20 * MAX_SEGMENT_SAMPLES * MACHINE.sample_period_s
    assert len(plan.program) > 5 * plan.path.segments
    assert samples.max() <= MAX_SEGMENT_SAMPLES
    assert plan.program.total_time_s == pytest.approx(plan.dwell.time_s.sum(), rel=1e-3)
    assert figures["executed_rms_nm"] < 0.02 * figures["initial_rms_nm"]  # type: ignore[operator]
