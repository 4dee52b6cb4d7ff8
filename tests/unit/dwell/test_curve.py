"""The curve of residual against beam time."""

import numpy as np
import pytest

from ibfctl.dwell.curve import TradeOffCurve, undominated, walk
from ibfctl.dwell.misfit import make_misfit
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import DwellProblem, Regularisation
from ibfctl.dwell.trade_off import Aim, Effort, TradeOff, TradeOffPoint, aim_at
from ibfctl.errors import CancelledError
from ibfctl.path.raster import raster
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import Rectangle, SurfaceMap
from tests.support.small_job import small_height_nm

REGULARISATION = Regularisation(smoothing=0.0)


def _point(time_s: float, rms_nm: float) -> TradeOffPoint:
    return TradeOffPoint(1.0, rms_nm, time_s, np.array([time_s]))


@pytest.fixture(scope="module")
def problem() -> DwellProblem:
    surface = SurfaceMap.centred(small_height_nm(), 0.25)
    misfit = make_misfit(surface, np.isfinite(surface.height_nm), gaussian(1.6, 4.0, 2.0, 0.25), "tilt", 1)
    path = raster(Rectangle(-8.0, 8.0, -6.0, 6.0), 1.0, 1.0)
    operator = RemovalOperator(misfit.grid, misfit.influence, path.dwell_x_mm, path.dwell_y_mm)
    return DwellProblem(operator, misfit, np.full(path.segments, 0.01), np.full(path.segments, np.inf))


@pytest.fixture(scope="module")
def found(problem: DwellProblem) -> TradeOff:
    return aim_at(
        problem,
        problem.rms_nm,
        Aim(0.05),
        start_s=problem.lower_s,
        regularisation=REGULARISATION,
        effort=Effort(),
    )


@pytest.fixture(scope="module")
def curve(problem: DwellProblem, found: TradeOff) -> TradeOffCurve:
    return walk(problem, problem.rms_nm, found, regularisation=REGULARISATION)


def test_it_spans_from_the_shortest_times_to_the_floor(
    problem: DwellProblem, found: TradeOff, curve: TradeOffCurve
) -> None:
    assert len(curve.points) > 10
    assert curve.points[0].total_time_s == pytest.approx(problem.lower_s.sum(), rel=0.02)
    assert curve.points[0].rms_nm == pytest.approx(problem.rms_nm(problem.lower_s), rel=0.02)
    assert curve.points[-1].rms_nm <= found.floor.rms_nm


def test_longer_runs_leave_less_and_up_to_the_chosen_one_each_second_gains_less(curve: TradeOffCurve) -> None:
    time_s = np.array([point.total_time_s for point in curve.points])
    rms_nm = np.array([point.rms_nm for point in curve.points])
    assert (np.diff(time_s) > 0).all()
    assert (np.diff(rms_nm) < 0).all()
    shorter = time_s < 0.99 * curve.chosen.total_time_s
    assert shorter.sum() > 8
    slope = np.diff(rms_nm[shorter] ** 2) / np.diff(time_s[shorter])
    assert (np.diff(slope) > 0).all()


def test_the_chosen_point_is_on_it_and_serves_the_aim(found: TradeOff, curve: TradeOffCurve) -> None:
    assert any(point is curve.chosen for point in curve.points)
    assert curve.chosen.total_time_s <= found.chosen.total_time_s
    assert curve.chosen.rms_nm <= found.chosen.rms_nm <= 1.05 * found.floor.rms_nm


def test_a_floor_that_was_chosen_itself_still_gives_a_curve(problem: DwellProblem, found: TradeOff) -> None:
    curve = walk(
        problem, problem.rms_nm, TradeOff(found.floor, found.floor), regularisation=REGULARISATION, iterations=20
    )
    assert len(curve.points) > 5


def test_where_nothing_is_to_be_gained_the_curve_is_one_point(problem: DwellProblem) -> None:
    least = TradeOffPoint(0.0, problem.rms_nm(problem.lower_s), float(problem.lower_s.sum()), problem.lower_s)
    hopeless = DwellProblem(problem.operator, problem.misfit, problem.lower_s, problem.lower_s)
    curve = walk(hopeless, hopeless.rms_nm, TradeOff(least, least), regularisation=REGULARISATION)
    assert [point.total_time_s for point in curve.points] == [least.total_time_s]


def test_dominated_points_are_dropped() -> None:
    points = [_point(3, 1.0), _point(1, 5.0), _point(2, 5.0), _point(4, 2.0), _point(1, 6.0), _point(5, 0.5)]
    assert [(p.total_time_s, p.rms_nm) for p in undominated(points)] == [(1, 5.0), (3, 1.0), (5, 0.5)]


def test_it_can_be_cancelled(problem: DwellProblem, found: TradeOff) -> None:
    with pytest.raises(CancelledError):
        walk(problem, problem.rms_nm, found, regularisation=REGULARISATION, cancelled=lambda: True)
