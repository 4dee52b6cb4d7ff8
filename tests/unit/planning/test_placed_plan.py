"""A part that stands shifted, rotated or mirrored on the machine: the same removal, another program."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibfctl.dwell.deposition import grid_of
from ibfctl.dwell.motion import executed_removal, motion_points
from ibfctl.errors import LimitsError
from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.machine.placement import Placement
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.as_run import as_run_figures
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import Plan
from ibfctl.planning.planner import make_plan
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.map import SurfaceMap
from tests.support.small_job import small_height_nm

OPTIONS = PlanOptions(pitch_mm=1.0, step_mm=1.0)
SURFACE = SurfaceMap.centred(small_height_nm(), 0.25)
Y, X = np.mgrid[-2:2:33j, -2:2:33j]
LONG = InfluenceFunction(4 * np.exp(-(X**2) / 0.8 - (Y - 0.2) ** 2 / 0.5) * (np.hypot(X, Y) <= 2), 0.125)


@pytest.fixture(scope="module")
def machine() -> MachineDescription:
    return read_machine(shipped_machine("simulator"))


def planned(machine: MachineDescription, placement: Placement, **choices: object) -> Plan:
    return make_plan(SURFACE, LONG, machine, replace(OPTIONS, placement=placement, **choices))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def as_mounted(machine: MachineDescription) -> Plan:
    return planned(machine, Placement())


def test_a_shift_shifts_the_program_and_nothing_else(machine: MachineDescription, as_mounted: Plan) -> None:
    shifted = planned(machine, Placement(12.5, -7.25))
    for coordinate, counts in (("x", 125_000), ("y", -72_500)):
        one, other = as_mounted.program.axis_of(coordinate), shifted.program.axis_of(coordinate)
        assert other.start_counts - one.start_counts == counts
        assert np.array_equal(one.increment_counts, other.increment_counts)
    assert np.array_equal(as_mounted.path.x_mm, shifted.path.x_mm)
    assert shifted.summary()["executed_rms_nm"] == pytest.approx(as_mounted.summary()["executed_rms_nm"], rel=1e-3)
    assert shifted.summary()["placement"]["offset_x_mm"] == 12.5  # type: ignore[index]
    assert "placement" not in as_mounted.summary()


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_right_angle_is_as_turning_the_map(machine: MachineDescription, mirrored: bool) -> None:
    placed = planned(machine, Placement(0.0, 0.0, 90.0, mirrored), loop=False)
    # Machine x is -y of the part; machine y its x, or -x where mirrored.
    turned = np.rot90(SURFACE.height_nm[:, ::-1] if mirrored else SURFACE.height_nm, -1)
    by_hand = make_plan(SurfaceMap.centred(turned, 0.25), LONG, machine, replace(OPTIONS, scan_axis="y", loop=False))
    for name in ("initial_rms_nm", "ideal_rms_nm"):
        assert placed.summary()[name] == pytest.approx(by_hand.summary()[name], rel=2e-2)
    assert placed.program.total_time_s == pytest.approx(by_hand.program.total_time_s, rel=1e-2)
    # Lines along the part's x are lines along the machine's y.
    assert (placed.program.axis_of("y").increment_counts != 0).mean() > 0.9


@pytest.mark.parametrize("placement", [Placement(5, 3, 30.0), Placement(-5, 3, -71.5, True)])
def test_whatever_the_angle_what_the_machine_executes_removes_what_is_to_go(
    machine: MachineDescription, placement: Placement
) -> None:
    plan = planned(machine, placement)
    assert plan.certificate.passed
    assert plan.summary()["executed_rms_nm"] < 0.05 * plan.summary()["initial_rms_nm"]  # type: ignore[operator]
    # Written out in machine coordinates: where the stages are, what the tool removes there, seen at the part's pixels.
    points = motion_points(plan.program, 8)
    x_mm, y_mm = (values.ravel() for values in np.meshgrid(SURFACE.x_mm, SURFACE.y_mm))
    pixels = placement(x_mm, y_mm)
    removal_nm = np.zeros(x_mm.size)
    for x, y, seconds in zip(points.x_mm.ravel(), points.y_mm.ravel(), points.time_s.ravel(), strict=True):
        dx, dy = pixels[0] - x, pixels[1] - y
        rate = 4 * np.exp(-(dx**2) / 0.8 - (dy - 0.2) ** 2 / 0.5) * (np.hypot(dx, dy) <= 2)
        removal_nm += seconds * rate
    assert plan.prediction is not None
    expected_nm = plan.prediction.executed_removal_nm.ravel()
    assert np.sqrt(np.mean((removal_nm - expected_nm) ** 2)) < 0.003 * expected_nm.mean()


def test_as_run_figures_start_from_the_stages(machine: MachineDescription) -> None:
    placement = Placement(4.0, -6.0, 40.0, True)
    plan = planned(machine, placement, loop=False)
    points = motion_points(plan.program, 200)
    # A segment of h seconds has h/200-ish a point: resample by time to equal steps.
    time_s = points.time_s.ravel()
    ends_s = np.cumsum(time_s)
    period_s = 1 / 1024
    place = np.searchsorted(ends_s, np.arange(0.5 * period_s, ends_s[-1], period_s))
    run = as_run_figures(plan, points.x_mm.ravel()[place], points.y_mm.ravel()[place], period_s)
    assert run.rms_difference_nm < 0.05
    assert run.rms_nm == pytest.approx(plan.summary()["executed_rms_nm"], abs=0.02)


def test_travel_is_that_of_the_machine(machine: MachineDescription) -> None:
    high = machine.axes["A"].travel_max_mm
    with pytest.raises(LimitsError, match="travel of axis A"):
        planned(machine, Placement(high, 0.0))


def test_limits_hold_on_the_machine_where_the_part_is_turned(machine: MachineDescription) -> None:
    slow = machine.axes["B"].model_copy(update={"v_max_mm_s": 3.0, "a_max_mm_s2": 50.0})
    slow_y = machine.model_copy(update={"axes": {**machine.axes, "B": slow}})
    plan = planned(slow_y, Placement(rotation_deg=90.0), loop=False)
    assert plan.summary()["peak_velocity_mm_s"]["B"] <= 3.0  # type: ignore[index]
    assert plan.program.total_time_s > 1.2 * planned(slow_y, Placement(), loop=False).program.total_time_s


def test_the_removal_of_a_program_is_asked_for_on_the_part(machine: MachineDescription) -> None:
    placement = Placement(2.0, 1.0)
    plan = planned(machine, placement, loop=False)
    assert plan.prediction is not None
    again = executed_removal(plan.program, grid_of(SURFACE), LONG, placement=placement)
    np.testing.assert_allclose(again, plan.prediction.executed_removal_nm)
    assert not np.allclose(executed_removal(plan.program, grid_of(SURFACE), gaussian(1.6, 4.0, 2.0, 0.1)), again)
