"""The spiral covers its disc in turns of one pitch, without crossing itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.errors import InputError
from ibfctl.path.figures import path_figures
from ibfctl.path.spiral import spiral
from tests.support.crossings import crossings

CENTRE = (3.0, -2.0)


def disc(radius_mm: float) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(*(np.linspace(-radius_mm, radius_mm, 161) + middle for middle in CENTRE))
    inside = np.hypot(x - CENTRE[0], y - CENTRE[1]) <= radius_mm
    return x[inside], y[inside]


@settings(deadline=None, max_examples=40)
@given(
    radius_mm=st.floats(0.3, 8.0), pitch_mm=st.floats(0.3, 4.0), step_mm=st.floats(0.2, 5.0), inside_out=st.booleans()
)
def test_the_disc_is_covered_without_crossing(
    radius_mm: float, pitch_mm: float, step_mm: float, inside_out: bool
) -> None:
    path = spiral(CENTRE, radius_mm, pitch_mm, step_mm, inside_out=inside_out)
    assert crossings(path) == 0
    assert path.length_mm.max() <= step_mm * (1 + 1e-6)
    gap_mm = path_figures(path, disc(radius_mm)).largest_gap_mm
    assert gap_mm is not None
    assert gap_mm <= 0.56 * pitch_mm


def test_turns_are_one_pitch_apart_in_equal_steps() -> None:
    path = spiral(CENTRE, 20.0, 0.5, 0.5)
    reach_mm = np.hypot(path.x_mm - CENTRE[0], path.y_mm - CENTRE[1])
    angle = np.unwrap(np.arctan2(path.y_mm - CENTRE[1], path.x_mm - CENTRE[0]))
    np.testing.assert_allclose(np.diff(reach_mm) / np.diff(angle), 0.5 / (2 * np.pi), rtol=1e-9)
    assert np.percentile(path.length_mm, 2) == pytest.approx(0.5, rel=1e-2)
    assert path.length_mm.sum() == pytest.approx(np.pi * 20.25**2 / 0.5, rel=0.01)
    assert path_figures(path).sharpest_corner_deg < 75


def test_it_starts_outside_unless_told_otherwise() -> None:
    inwards, outwards = (spiral(CENTRE, 5.0, 0.5, 0.5, inside_out=given) for given in (False, True))
    np.testing.assert_array_equal(inwards.x_mm, outwards.x_mm[::-1])
    assert np.hypot(inwards.x_mm[0] - CENTRE[0], inwards.y_mm[0] - CENTRE[1]) == pytest.approx(5.25)
    assert np.hypot(inwards.x_mm[-1] - CENTRE[0], inwards.y_mm[-1] - CENTRE[1]) == pytest.approx(0.125)


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_spacing_that_is_none_is_refused(value: float) -> None:
    with pytest.raises(InputError, match="pitch"):
        spiral(CENTRE, 5.0, value, 0.5)
    with pytest.raises(InputError, match="step"):
        spiral(CENTRE, 5.0, 0.5, value)


@pytest.mark.parametrize(("pitch_mm", "step_mm"), [(1e-9, 0.5), (0.5, 1e-9), (1e-3, 1e-3)])
def test_a_spacing_that_would_fill_the_memory_is_refused(pitch_mm: float, step_mm: float) -> None:
    with pytest.raises(InputError, match="more than"):
        spiral(CENTRE, 50.0, pitch_mm, step_mm)
