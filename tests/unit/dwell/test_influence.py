"""Influence functions: the volume they remove survives every change of pitch; nonsense is refused."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.dwell.misfit import full_width_mm
from ibfctl.errors import InputError
from ibfctl.surface.influence import InfluenceFunction, gaussian

FWHM_MM, PEAK_NM_S, RADIUS_MM = 2.0, 7.0, 5.0


def test_a_gaussian_has_the_peak_the_width_and_the_volume_that_were_asked_for() -> None:
    tif = gaussian(FWHM_MM, PEAK_NM_S, RADIUS_MM, 0.05)
    assert tif.peak_rate_nm_s == PEAK_NM_S
    assert tif.radius_mm == pytest.approx(RADIUS_MM)
    middle = tif.rate_nm_s.shape[0] // 2
    assert tif.rate_nm_s[middle, middle] == PEAK_NM_S
    assert tif.rate_nm_s[middle, middle + 20] == pytest.approx(PEAK_NM_S / 2)
    assert tif.volume_rate_nm_mm2_s == pytest.approx(PEAK_NM_S * np.pi * FWHM_MM**2 / (4 * np.log(2)), rel=1e-4)
    assert np.array_equal(tif.rate_nm_s, tif.rate_nm_s.T)
    assert np.array_equal(tif.rate_nm_s, tif.rate_nm_s[::-1, ::-1])
    assert full_width_mm(tif) == pytest.approx(FWHM_MM, rel=1e-3)


def test_a_gaussian_is_cut_at_its_radius() -> None:
    tif = gaussian(4.0, 1.0, 1.0, 0.25)
    assert tif.rate_nm_s.shape == (9, 9)
    distance = 0.25 * np.hypot(*(np.indices((9, 9)) - 4))
    assert ((tif.rate_nm_s > 0) == (distance <= 1.0)).all()


@pytest.mark.parametrize("name", ["fwhm_mm", "peak_nm_s", "radius_mm", "pixel_mm"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_gaussian_of_nonsense_is_refused_by_name(name: str, value: float) -> None:
    given = {"fwhm_mm": 2.0, "peak_nm_s": 7.0, "radius_mm": 5.0, "pixel_mm": 0.5, name: value}
    with pytest.raises(InputError, match=name):
        gaussian(**given)


@pytest.mark.parametrize("pixel_mm", [0.05, 0.1, 0.13, 0.25, 0.4, 1.0])
@pytest.mark.parametrize("shape", [(41, 41), (40, 40), (40, 61), (3, 3)])
def test_another_pitch_keeps_the_volume_rate_and_the_centre(shape: tuple[int, int], pixel_mm: float) -> None:
    y, x = (0.2 * (np.arange(size) - 0.5 * (size - 1)) for size in shape)
    tif = InfluenceFunction(3 * np.exp(-(x[None, :] ** 2 / 2) - (y[:, None] ** 2 / 4)), 0.2)
    other = tif.resampled(pixel_mm)
    assert other.pixel_mm == pixel_mm
    assert all(size % 2 for size in other.rate_nm_s.shape)
    assert other.volume_rate_nm_mm2_s == pytest.approx(tif.volume_rate_nm_mm2_s, rel=1e-12)
    for axis in (0, 1):
        profile = other.rate_nm_s.sum(axis=1 - axis)
        place = np.arange(profile.size) - profile.size // 2
        assert np.average(place, weights=profile) == pytest.approx(0.0, abs=1e-9)


def test_a_finer_pitch_follows_the_function_itself() -> None:
    fine = gaussian(FWHM_MM, PEAK_NM_S, RADIUS_MM, 0.2).resampled(0.07)
    axis_mm = 0.07 * (np.arange(fine.rate_nm_s.shape[0]) - fine.rate_nm_s.shape[0] // 2)
    exact = PEAK_NM_S * np.exp(-4 * np.log(2) * (axis_mm[:, None] ** 2 + axis_mm[None, :] ** 2) / FWHM_MM**2)
    assert np.abs(fine.rate_nm_s - exact).max() < 1e-4 * PEAK_NM_S


def test_its_own_pitch_is_no_change() -> None:
    tif = gaussian(FWHM_MM, PEAK_NM_S, RADIUS_MM, 0.2)
    assert tif.resampled(0.2) is tif


@pytest.mark.parametrize(
    ("rate", "pixel_mm", "said"),
    [
        (np.ones(5), 0.1, "table of at least 3 x 3"),
        (np.ones((2, 5)), 0.1, "table of at least 3 x 3"),
        (np.ones((5, 5)), 0.0, "pixel size"),
        (np.ones((5, 5)), -0.1, "pixel size"),
        (np.ones((5, 5)), float("nan"), "pixel size"),
        (np.full((5, 5), np.nan), 0.1, "NaN or infinite"),
        (np.zeros((5, 5)), 0.1, "removes nothing"),
        (-np.ones((5, 5)), 0.1, "removes nothing"),
    ],
)
def test_a_table_of_nonsense_is_refused(rate: np.ndarray, pixel_mm: float, said: str) -> None:
    with pytest.raises(InputError, match=said):
        InfluenceFunction(rate, pixel_mm)
