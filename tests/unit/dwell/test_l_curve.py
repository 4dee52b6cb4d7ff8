"""The L-curve: its corner on known curves, and on a map whose finest errors the tool cannot reach."""

import numpy as np
import pytest
from scipy import ndimage

from ibfctl.dwell.l_curve import LCurve, l_curve, most_curved
from ibfctl.dwell.misfit import make_misfit
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import DwellProblem, Regularisation
from ibfctl.errors import CancelledError
from ibfctl.path.raster import raster
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import Rectangle, SurfaceMap

PIXELS = 40


@pytest.fixture(scope="module")
def problem() -> DwellProblem:
    random = np.random.default_rng(8).normal(size=(2, PIXELS, PIXELS))
    smooth, rough = (ndimage.gaussian_filter(noise, width) for noise, width in zip(random, (4.0, 1.0), strict=True))
    surface = SurfaceMap.centred(20 * smooth / smooth.std() + 2 * rough / rough.std(), 0.5)
    misfit = make_misfit(surface, np.ones((PIXELS, PIXELS), dtype=bool), gaussian(4.0, 10.0, 5.0, 0.5), "tilt", 1)
    path = raster(Rectangle(-15.0, 15.0, -15.0, 15.0), 1.0, 1.0)
    operator = RemovalOperator(misfit.grid, misfit.influence, path.dwell_x_mm, path.dwell_y_mm)
    return DwellProblem(operator, misfit, np.zeros(path.segments), np.full(path.segments, np.inf))


@pytest.fixture(scope="module")
def walked(problem: DwellProblem) -> LCurve:
    return l_curve(problem, problem.lower_s, Regularisation(smoothing=0.0))


def test_less_regularisation_leaves_less_and_takes_larger_times(walked: LCurve) -> None:
    assert (np.diff(walked.residual_nm2) < 0).all()
    assert (np.diff(walked.norm_s2) > 0).all()


def test_the_corner_parts_what_pays_from_what_does_not(walked: LCurve) -> None:
    corner = walked.corner
    left_nm = np.sqrt(walked.residual_nm2)
    # Seen: one decade more leaves 26 % more; all five decades less leave 15 % less for three times the squared norm.
    assert left_nm[corner - 2] > 1.2 * left_nm[corner]
    assert left_nm[-1] > 0.75 * left_nm[corner]
    assert walked.norm_s2[-1] > 1.6 * walked.norm_s2[corner]
    assert walked.chosen == walked.factor[corner]


def test_a_corner_between_two_straight_legs_is_found() -> None:
    residual = np.concatenate([np.logspace(2, 0, 9), np.logspace(0, -0.02, 9)[1:]])
    norm = np.concatenate([np.logspace(0, 0.02, 9), np.logspace(0.02, 3, 9)[1:]])
    assert most_curved(residual, norm) == 8


def test_the_scales_of_the_axes_do_not_matter() -> None:
    angle = np.linspace(np.pi, 1.5 * np.pi, 31)[::-1]
    power = 0.2  # a rounded corner, sharpest on the diagonal
    across, up = (1 - np.abs(part(angle)) ** power for part in (np.cos, np.sin))
    middle = most_curved(10.0**across, 10.0**up)
    assert abs(middle - 15) <= 1
    assert most_curved(1e6 * 10.0 ** (3 * across), 1e-3 * 10.0**up) == middle


def test_a_curve_that_never_turns_asks_for_no_regularisation() -> None:
    residual = np.logspace(2, -2, 9)
    assert most_curved(residual, residual**-0.5) == 8
    assert most_curved(np.ones(9), np.ones(9)) == 8


def test_it_can_be_cancelled(problem: DwellProblem) -> None:
    with pytest.raises(CancelledError):
        l_curve(problem, problem.lower_s, Regularisation(), cancelled=lambda: True)
