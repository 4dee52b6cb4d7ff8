"""Plans with rounded corners: certified, no worse than with sharp ones, and honest about what rounding lowers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ibfctl.errors import CancelledError, InputError
from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.machine.placement import Placement
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.file import read_plan, write_plan
from ibfctl.planning.job import corridor_of
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import Plan, peaks
from ibfctl.planning.planner import make_plan
from ibfctl.planning.restart import restart
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.map import SurfaceMap
from tests.support.small_job import small_height_nm

OPTIONS = PlanOptions(path="maze", pitch_mm=1.0, corner_tolerance_mm=0.05)


@pytest.fixture(scope="module")
def machine() -> MachineDescription:
    return read_machine(shipped_machine("nsls2-ibf"))


@pytest.fixture(scope="module")
def surface() -> SurfaceMap:
    return SurfaceMap.centred(small_height_nm(), 0.25)


@pytest.fixture(scope="module")
def tool() -> InfluenceFunction:
    return gaussian(1.6, 4.0, 2.0, 0.1)


@pytest.fixture(scope="module")
def plan(surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription) -> Plan:
    return make_plan(surface, tool, machine, OPTIONS)


def test_a_rounded_plan_is_certified_to_its_tolerance(plan: Plan) -> None:
    assert plan.certificate.passed
    assert plan.smoothing is not None
    assert 0 < plan.smoothing.deviation_mm <= 0.05
    checks = {check.name: check for check in plan.certificate.checks}
    assert checks["deviation_mm"].limit == 0.05
    assert plan.smoothing.corners == np.count_nonzero(~plan.path.straight)


def test_rounding_is_judged_against_sharp_corners_planned_alike(
    plan: Plan, surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    sharp = make_plan(surface, tool, machine, replace(OPTIONS, corner_tolerance_mm=None))
    assert sharp.smoothing is None
    said, found = plan.smoothing, plan.summary()
    assert said is not None
    assert said.sharp_executed_rms_nm == pytest.approx(sharp.summary()["executed_rms_nm"])
    assert said.sharp_total_time_s == pytest.approx(sharp.program.total_time_s)
    sharp_peaks = {letter: peak for letter, (_, peak) in peaks(sharp.program).items()}
    assert said.sharp_peak_acceleration_mm_s2 == pytest.approx(sharp_peaks)
    in_time = plan.program.total_time_s <= 1.005 * sharp.program.total_time_s
    lower = {
        "residual": in_time and found["executed_rms_nm"] < said.sharp_executed_rms_nm,
        "acceleration": in_time
        and all(peak < sharp_peaks[letter] for letter, (_, peak) in peaks(plan.program).items()),
    }
    assert said.lowers == tuple(name for name, is_lower in lower.items() if is_lower)
    assert "acceleration" in said.lowers


def test_motion_in_the_loop_works_on_rounded_corners(plan: Plan) -> None:
    assert len(plan.rounds) > 1
    assert plan.rounds[-1].rms_nm < 0.7 * plan.rounds[0].rms_nm


def test_a_rounded_plan_survives_its_file(plan: Plan, tmp_path: Path) -> None:
    write_plan(plan, tmp_path / "plan.h5")
    again = read_plan(tmp_path / "plan.h5")
    assert again.smoothing == plan.smoothing
    assert again.options == plan.options
    assert again.summary()["smoothing"] == plan.summary()["smoothing"]


def test_corners_are_rounded_on_a_part_that_stands_turned(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    placed = replace(OPTIONS, placement=Placement(5.0, -3.0, 30.0, mirrored=True), loop=False)
    plan = make_plan(surface, tool, machine, placed)
    assert plan.certificate.passed
    assert plan.smoothing is not None
    assert plan.smoothing.deviation_mm <= 0.05
    assert plan.summary()["executed_rms_nm"] < 0.2 * plan.summary()["initial_rms_nm"]  # type: ignore[operator]


def test_the_rest_of_a_rounded_plan_is_walked_along_its_blocks(plan: Plan) -> None:
    path, scheduled = restart(plan, 0.4 * float(plan.program.time_samples.sum()), corridor_of(plan.options))
    assert scheduled is not None
    assert scheduled.certificate.passed
    assert path.segments > plan.path.segments  # blocks have more nodes than corners
    np.testing.assert_array_equal(
        scheduled.program.axis_of("x").increment_counts[-50:], plan.program.axis_of("x").increment_counts[-50:]
    )


def test_a_tolerance_finer_than_the_counts_is_refused(
    surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription
) -> None:
    with pytest.raises(InputError, match="corner tolerance"):
        make_plan(surface, tool, machine, replace(OPTIONS, corner_tolerance_mm=1e-4))


def test_rounding_can_be_cancelled(surface: SurfaceMap, tool: InfluenceFunction, machine: MachineDescription) -> None:
    stages: list[str] = []
    with pytest.raises(CancelledError):
        make_plan(
            surface,
            tool,
            machine,
            OPTIONS,
            progress=lambda stage, fraction: stages.append(stage),
            cancelled=lambda: "scheduling" in stages,
        )
    assert stages[-1] == "scheduling"
