"""The comparison of schedulers: the same path and times for all, and what the published one says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibfctl.errors import CancelledError
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.comparison import ComparedPath, compare, path_choices, summary
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.planner import make_plan
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import SurfaceMap
from tests.support.small_job import small_height_nm

MACHINE = read_machine(shipped_machine("nsls2-ibf"))
SURFACE = SurfaceMap.centred(small_height_nm(), 0.25)
TOOL = gaussian(1.6, 4.0, 2.0, 0.25)
OPTIONS = PlanOptions(pitch_mm=1.0, step_mm=1.0)
JERK_MM_S3 = 5000.0


@pytest.fixture(scope="module")
def compared() -> dict[str, ComparedPath]:
    choices = path_choices(("raster", "maze"), OPTIONS)
    return compare(SURFACE, TOOL, MACHINE, choices, jerk_max_mm_s3=JERK_MM_S3)


def test_a_raster_is_compared_along_both_axes(compared: dict[str, ComparedPath]) -> None:
    assert list(compared) == ["raster x", "raster y", "maze"]
    for path in compared.values():
        assert list(path.schedulers) == [
            "pvt",
            "pvt, jerk limited",
            "pvt, classic dwell times",
            "pvt, motion in the loop",
            "constant acceleration",
            "position mode",
        ]


def test_pvt_stays_on_the_path_and_is_smoother_than_constant_acceleration(compared: dict[str, ComparedPath]) -> None:
    for path in compared.values():
        pvt, constant = path.schedulers["pvt"], path.schedulers["constant acceleration"]
        assert pvt.overshoot_mm == 0.0
        assert pvt.excursion_mm <= 0.05
        assert constant.overshoot_mm > 1e-3
        assert pvt.rms_acceleration_jump_mm_s2 < 0.5 * constant.rms_acceleration_jump_mm_s2
        assert constant.peak_acceleration_mm_s2 == {"x": 2000.0, "y": 1000.0}
        assert constant.total_time_s == pytest.approx(pvt.total_time_s, rel=1e-3)


def test_the_loop_leaves_no_more_and_takes_no_longer_than_the_plain_chain(compared: dict[str, ComparedPath]) -> None:
    for path in compared.values():
        plain, loop = path.schedulers["pvt"], path.schedulers["pvt, motion in the loop"]
        assert loop.executed_rms_nm <= plain.executed_rms_nm
        assert loop.total_time_s <= 1.01 * plain.total_time_s


def test_limits_that_come_last_leave_more() -> None:
    # At 1 mm/s or more many of the times that are wanted are cut.
    (choice,) = path_choices(("maze",), replace(OPTIONS, v_min_mm_s=1.0)).values()
    rows = compare(SURFACE, TOOL, MACHINE, {"maze": choice})["maze"].schedulers
    assert rows["pvt, classic dwell times"].executed_rms_nm > 1.2 * rows["pvt"].executed_rms_nm


def test_position_mode_pays_for_its_stops_in_time(compared: dict[str, ComparedPath]) -> None:
    for path in compared.values():
        assert path.schedulers["position mode"].total_time_s > 1.1 * path.schedulers["pvt"].total_time_s


def test_a_limit_of_the_jerk_costs_time_and_lowers_the_jumps(compared: dict[str, ComparedPath]) -> None:
    maze = compared["maze"].schedulers
    assert maze["pvt, jerk limited"].total_time_s > maze["pvt"].total_time_s
    assert maze["pvt, jerk limited"].largest_acceleration_jump_mm_s2 < maze["pvt"].largest_acceleration_jump_mm_s2


def test_the_figures_of_pvt_are_those_of_a_plan() -> None:
    options = path_choices(("maze",), OPTIONS)["maze"]
    figures = compare(SURFACE, TOOL, MACHINE, {"maze": options})["maze"]
    plan = make_plan(SURFACE, TOOL, MACHINE, options).summary()
    loop = figures.schedulers["pvt, motion in the loop"]
    assert "pvt, jerk limited" not in figures.schedulers
    assert loop.executed_rms_nm == pytest.approx(plan["executed_rms_nm"], rel=1e-6)
    assert loop.total_time_s == pytest.approx(plan["total_time_s"])
    assert figures.ideal_rms_nm == pytest.approx(plan["ideal_rms_nm"], rel=1e-6)
    assert plan["path"] == summary({"maze": figures})["paths"]["maze"]["path"]  # type: ignore[index]
    assert plan["path"]["largest_gap_mm"] <= 1.0 / np.sqrt(2) + 1e-9  # type: ignore[index]


def test_a_comparison_can_be_cancelled() -> None:
    with pytest.raises(CancelledError):
        compare(SURFACE, TOOL, MACHINE, path_choices(("raster",), OPTIONS), cancelled=lambda: True)


def test_rounded_corners_stand_beside_sharp_ones() -> None:
    (choice,) = path_choices(("maze",), replace(OPTIONS, corner_tolerance_mm=0.05)).values()
    rows = compare(SURFACE, TOOL, MACHINE, {"maze": choice}, jerk_max_mm_s3=JERK_MM_S3)["maze"].schedulers
    sharp = compare(SURFACE, TOOL, MACHINE, {"maze": replace(choice, corner_tolerance_mm=None)})["maze"].schedulers
    assert list(sharp) == [name for name in rows if name in sharp]
    assert rows["pvt"] == sharp["pvt"]
    assert [name for name in rows if name not in sharp] == [
        "pvt, jerk limited",
        "rounded",
        "rounded, jerk limited",
        "rounded, in the loop",
    ]
    pvt, smooth = rows["pvt"], rows["rounded"]
    assert smooth.excursion_mm <= 0.05
    assert smooth.total_time_s <= 1.005 * pvt.total_time_s
    for axis in ("x", "y"):
        assert smooth.peak_acceleration_mm_s2[axis] < pvt.peak_acceleration_mm_s2[axis]
        assert rows["rounded, jerk limited"].peak_jerk_mm_s3[axis] <= JERK_MM_S3
        assert smooth.peak_jerk_mm_s3[axis] > JERK_MM_S3
    assert rows["rounded, in the loop"].executed_rms_nm < 0.5 * smooth.executed_rms_nm
