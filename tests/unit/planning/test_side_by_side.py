"""Methods side by side: all are executed within the limits, and ours leaves least in the shortest time."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.dwell.methods.smoothness import slope_rms_s_mm
from ibfctl.errors import CancelledError
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.path.raster import raster
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.planner import make_plan
from ibfctl.planning.side_by_side import MethodFigures, compare_methods
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import Rectangle, SurfaceMap
from tests.support.small_job import small_height_nm

MACHINE = read_machine(shipped_machine("nsls2-ibf"))
SURFACE = SurfaceMap.centred(small_height_nm(), 0.25)
TOOL = gaussian(1.6, 4.0, 2.0, 0.25)
PATHS = {"raster": PlanOptions(pitch_mm=1.0, step_mm=1.0), "maze": PlanOptions(path="maze", pitch_mm=1.0)}


@pytest.fixture(scope="module")
def compared() -> dict[str, dict[str, MethodFigures]]:
    return compare_methods(SURFACE, TOOL, MACHINE, PATHS)


@pytest.mark.parametrize("path", PATHS)
def test_every_method_corrects_the_map_within_the_limits(
    compared: dict[str, dict[str, MethodFigures]], path: str
) -> None:
    initial_nm = float(np.std(SURFACE.height_nm))
    assert list(compared[path]) == [
        "inverse filter",
        "NNLS, then limits",
        "damped LSMR",
        "damped LSMR, extended",
        "ours, no loop",
        "ours",
    ]
    for figures in compared[path].values():
        assert figures.bound_violation_s < 1e-9
        assert figures.executed_rms_nm < 0.6 * initial_nm
        assert 0 < figures.peak_speed_mm_s <= 250
        assert figures.slope_rms_s_mm > 0
        assert figures.planning_s > 0


@pytest.mark.parametrize("path", PATHS)
def test_ours_is_the_shortest_of_those_that_leave_as_little(
    compared: dict[str, dict[str, MethodFigures]], path: str
) -> None:
    ours = compared[path]["ours"]
    for name, figures in compared[path].items():
        if not name.startswith("ours") and figures.executed_rms_nm <= 1.02 * ours.executed_rms_nm:
            assert figures.total_time_s > ours.total_time_s
    assert ours.executed_rms_nm <= compared[path]["ours, no loop"].executed_rms_nm


def test_ours_is_what_a_plan_does(compared: dict[str, dict[str, MethodFigures]]) -> None:
    plan = make_plan(SURFACE, TOOL, MACHINE, PATHS["raster"]).summary()
    ours = compared["raster"]["ours"]
    assert ours.executed_rms_nm == pytest.approx(plan["executed_rms_nm"], rel=1e-6)
    assert ours.total_time_s == pytest.approx(plan["total_time_s"])
    assert ours.peak_speed_mm_s == pytest.approx(max(plan["peak_velocity_mm_s"].values()))  # type: ignore[attr-defined]


def test_the_comparison_can_be_cancelled() -> None:
    with pytest.raises(CancelledError):
        compare_methods(SURFACE, TOOL, MACHINE, PATHS, cancelled=lambda: True)


def test_the_slope_is_taken_along_the_lines_alone() -> None:
    path = raster(Rectangle(0, 4, 0, 2), 1.0, 0.5)
    assert slope_rms_s_mm(path, np.full(path.segments, 2.0)) == 0
    along_x = 0.3 * path.dwell_x_mm
    assert slope_rms_s_mm(path, along_x) == pytest.approx(0.3)
    jump_at_the_turn = np.where(path.dwell_y_mm < 0.5, 1.0, 7.0)
    assert slope_rms_s_mm(path, jump_at_the_turn) == 0
    corner = ToolPath(np.array([0.0, 1.0, 1.0]), np.array([0.0, 0.0, 1.0]))
    assert slope_rms_s_mm(corner, np.array([1.0, 5.0])) == 0
