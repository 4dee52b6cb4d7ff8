import math
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from ibfctl.dwell.deposition import grid_of
from ibfctl.dwell.motion import executed_removal, motion_points
from ibfctl.dwell.operator import removal_of_samples
from ibfctl.errors import CancelledError, InputError
from ibfctl.machine.description import read_machine
from ibfctl.machine.placement import Placement
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import Plan
from ibfctl.planning.planner import make_plan
from ibfctl.planning.tolerance import Tolerances, tolerance_of
from ibfctl.planning.tolerance_draws import Draw, Situation, residuals, situation_of
from ibfctl.schedule.certificate import axis_cubics
from ibfctl.surface.influence import gaussian
from ibfctl.surface.levelling import Levelling, rms
from ibfctl.surface.map import SurfaceMap
from tests.support.small_job import small_height_nm

NOTHING = Tolerances(0, 0, 0, 0, 0, 0)
FWHM_MM, PEAK_NM_S, RADIUS_MM, PIXEL_MM = 1.6, 4.0, 2.5, 0.25


class Here(Executor):
    """An executor that does everything at once, in place."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


@pytest.fixture(scope="module")
def plan() -> Plan:
    surface = SurfaceMap.centred(small_height_nm(), PIXEL_MM)
    tool = gaussian(FWHM_MM, PEAK_NM_S, RADIUS_MM, PIXEL_MM)
    machine = read_machine(shipped_machine("simulator"))
    return make_plan(surface, tool, machine, PlanOptions(pitch_mm=0.8, step_mm=0.8, loop=False))


@pytest.fixture(scope="module")
def situation(plan: Plan) -> Situation:
    found = situation_of(plan)
    assert found is not None
    return found


def _left_nm(situation: Situation, removal_nm: np.ndarray) -> float:
    mask = situation.clear_aperture
    return rms(Levelling.over(mask, situation.options.remove)((situation.surface.height_nm - removal_nm)[mask]))


def test_a_run_as_planned_leaves_what_was_predicted(plan: Plan, situation: Situation) -> None:
    ((rms_nm, pv_nm),) = residuals(situation, [Draw()])
    assert rms_nm == pytest.approx(plan.summary()["executed_rms_nm"], rel=1e-9)
    assert pv_nm == pytest.approx(plan.summary()["executed_pv_nm"], rel=1e-9)


def test_a_part_that_lies_off_sees_the_removal_elsewhere(plan: Plan, situation: Situation) -> None:
    grid = grid_of(situation.surface)
    wide = replace(grid, nx=grid.nx + 4, ny=grid.ny + 2, x0_mm=grid.x0_mm, y0_mm=grid.y0_mm - 2 * PIXEL_MM)
    removal_nm = executed_removal(situation.program, wide, situation.influence)
    moved_nm = removal_nm[: grid.ny, 4:]  # the part lies 4 pixels to the right and 2 lower
    ((rms_nm, _),) = residuals(situation, [Draw(offset_x_mm=4 * PIXEL_MM, offset_y_mm=-2 * PIXEL_MM)])
    assert rms_nm == pytest.approx(_left_nm(situation, moved_nm), rel=1e-9)


def test_a_turned_part_sees_the_removal_turned_back(situation: Situation) -> None:
    angle = 0.02
    fine = replace(grid_of(situation.surface), nx=68, ny=52, x0_mm=-8.375, y0_mm=-6.375)
    removal_nm = executed_removal(situation.program, fine, situation.influence)
    x_mm, y_mm = np.meshgrid(situation.surface.x_mm, situation.surface.y_mm)
    # Where a point of the part lies in the machine: turned about the middle of the aperture, then moved.
    x_machine = np.cos(angle) * x_mm - np.sin(angle) * y_mm + 0.3
    y_machine = np.sin(angle) * x_mm + np.cos(angle) * y_mm + 0.2
    places = [(y_machine - fine.y0_mm) / PIXEL_MM, (x_machine - fine.x0_mm) / PIXEL_MM]
    seen_nm = ndimage.map_coordinates(removal_nm, places, order=5)
    turned, back = Draw(rotation_rad=angle, offset_x_mm=0.3, offset_y_mm=0.2), Draw(0, 0, 0.3, 0.2, -angle)
    (rms_nm, _), (other_nm, _) = residuals(situation, [turned, back])
    assert rms_nm == pytest.approx(_left_nm(situation, seen_nm), rel=2e-3)
    assert abs(other_nm - rms_nm) > 0.02 * rms_nm


def test_a_wider_tool_removes_the_same_volume_over_more_area(situation: Situation) -> None:
    factor = 1.05
    wider = gaussian(FWHM_MM * factor, PEAK_NM_S / factor**2, RADIUS_MM * factor, PIXEL_MM / 4)
    removal_nm = executed_removal(situation.program, grid_of(situation.surface), wider)
    ((rms_nm, _),) = residuals(situation, [Draw(tif_width=math.log(factor))])
    assert rms_nm == pytest.approx(_left_nm(situation, removal_nm), rel=5e-3)


def test_a_drifting_rate_removes_more_the_later_it_is(situation: Situation) -> None:
    program, grid = situation.program, grid_of(situation.surface)
    motion = motion_points(program, 8)
    x_mm, y_mm, time_s = (values.ravel() for values in (motion.x_mm, motion.y_mm, motion.time_s))
    middle_s = np.cumsum(time_s) - 0.5 * time_s
    assert middle_s[-1] < program.total_time_s
    weight = 1 + 0.1 * middle_s / program.total_time_s
    stamps_nm = np.zeros((grid.ny, grid.nx))
    xs, ys = np.meshgrid(situation.surface.x_mm, situation.surface.y_mm)
    sigma2 = 2 * (FWHM_MM**2 / (8 * math.log(2)))
    for x, y, seconds in zip(x_mm, y_mm, time_s * weight, strict=True):
        r2 = (xs - x) ** 2 + (ys - y) ** 2
        stamps_nm += np.where(r2 <= RADIUS_MM**2, seconds * PEAK_NM_S * np.exp(-r2 / sigma2), 0.0)
    ((rms_nm, _),) = residuals(situation, [Draw(rate_drift=0.1)])
    assert rms_nm == pytest.approx(_left_nm(situation, stamps_nm), rel=0.02)


def test_a_lagging_axis_is_behind_by_its_velocity(situation: Situation) -> None:
    program, grid, lag_s = situation.program, grid_of(situation.surface), 0.02
    samples = np.linspace(0, 1, 64, endpoint=False) + 1 / 128
    tau_s = samples * program.time_s[:, None]
    place = {}
    for coordinate, lag in (("x", lag_s), ("y", 0.0)):
        axis = program.axis_of(coordinate)
        cubics = axis_cubics(program, axis)
        place[coordinate] = (cubics.position(tau_s) - lag * cubics.velocity(tau_s)) / axis.counts_per_mm
    time_s = np.broadcast_to(program.time_s[:, None] / 64, tau_s.shape)
    removal_nm = removal_of_samples(grid, situation.influence, place["x"].ravel(), place["y"].ravel(), time_s.ravel())
    ((rms_nm, _),) = residuals(situation, [Draw(lag_x_s=lag_s)])
    assert rms_nm == pytest.approx(_left_nm(situation, removal_nm), rel=1e-3)
    assert abs(rms_nm - residuals(situation, [Draw()])[0, 0]) > 1e-3 * rms_nm


def test_a_part_that_stands_turned_on_the_machine_is_left_as_predicted(plan: Plan) -> None:
    assert plan.surface is not None
    assert plan.influence is not None
    lopsided = replace(plan.influence, rate_nm_s=plan.influence.rate_nm_s * np.linspace(0.5, 1.5, 21))
    options = replace(plan.options, placement=Placement(5.0, -3.0, 30.0, mirrored=True))
    placed = make_plan(plan.surface, lopsided, plan.machine, options)
    situation = situation_of(placed)
    assert situation is not None
    (rms_nm, _), (moved_nm, _) = residuals(situation, [Draw(), Draw(offset_x_mm=0.5)])
    assert rms_nm == pytest.approx(placed.summary()["executed_rms_nm"], rel=1e-9)
    assert moved_nm > 1.5 * rms_nm


def test_noise_adds_its_variance(situation: Situation) -> None:
    planned_nm = residuals(situation, [Draw()])[0, 0]
    noisy = residuals(situation, [Draw(height_noise_nm=2.0, noise_seed=seed) for seed in range(40)])[:, 0]
    expected = math.sqrt(planned_nm**2 + 2.0**2 * (1 - 3 / situation.clear_aperture.sum()))
    assert math.sqrt((noisy**2).mean()) == pytest.approx(expected, rel=0.01)
    assert len(set(noisy)) == 40


@pytest.mark.parametrize(
    ("name", "tolerances"),
    [
        ("offset", replace(NOTHING, offset_mm=0.1)),
        ("rotation", replace(NOTHING, rotation_mrad=20.0)),
        ("rate_drift", replace(NOTHING, rate_drift_percent=10.0)),
        ("tif_width", replace(NOTHING, tif_width_percent=3.0)),
        ("servo_lag", replace(NOTHING, servo_lag_ms=30.0)),
        ("height_noise", replace(NOTHING, height_noise_nm=1.0)),
    ],
)
def test_what_a_cause_does_alone_is_the_mean_over_its_draws(plan: Plan, name: str, tolerances: Tolerances) -> None:
    figures = tolerance_of(plan, tolerances, Here(), draws=400, seed=5)
    assert list(figures.causes) == [name]
    assert figures.causes[name].share == pytest.approx(1.0)
    mean_square = figures.rms_nm.mean**2 + figures.rms_nm.standard_deviation**2
    added = mean_square - figures.predicted_rms_nm**2
    assert figures.causes[name].rms_nm ** 2 - figures.predicted_rms_nm**2 == pytest.approx(added, rel=0.2)


def test_the_strongest_cause_comes_first_and_shares_sum_to_one(plan: Plan) -> None:
    figures = tolerance_of(plan, replace(Tolerances(), offset_mm=0.5, height_noise_nm=0.2), Here(), draws=20)
    assert figures.summary()["dominant"] == "offset"
    assert len(figures.causes) == 6
    assert sum(cause.share for cause in figures.causes.values()) == pytest.approx(1.0)
    levels = list(figures.rms_nm.percentiles.values())
    assert levels == sorted(levels)
    assert figures.rms_nm.percentiles["p5"] > figures.predicted_rms_nm


def test_the_outcome_depends_on_the_seed_and_not_on_the_executor(plan: Plan) -> None:
    here = tolerance_of(plan, Tolerances(), Here(), draws=30, seed=7)
    with ThreadPoolExecutor(3) as threads:
        assert tolerance_of(plan, Tolerances(), threads, draws=30, seed=7) == here
    assert tolerance_of(plan, Tolerances(), Here(), draws=30, seed=8).rms_nm != here.rms_nm


def test_progress_ends_at_one_and_a_cancellation_is_heard(plan: Plan) -> None:
    said: list[float] = []
    tolerance_of(plan, Tolerances(), Here(), draws=5, progress=lambda stage, fraction: said.append(fraction))
    assert said[0] == 0.0
    assert said[-1] == 1.0
    answers: Iterator[bool] = iter([True])
    with pytest.raises(CancelledError):
        tolerance_of(plan, Tolerances(), Here(), draws=5, cancelled=lambda: next(answers))


def test_what_cannot_be_drawn_is_refused(plan: Plan) -> None:
    with pytest.raises(InputError, match="holds no map"):
        tolerance_of(replace(plan, surface=None), Tolerances(), Here())
    with pytest.raises(InputError, match="nothing varies"):
        tolerance_of(plan, NOTHING, Here())
