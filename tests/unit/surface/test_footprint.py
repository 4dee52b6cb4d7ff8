import math
from dataclasses import replace

import numpy as np
import pytest

from ibfctl.errors import InputError
from ibfctl.surface.footprint import footprint
from ibfctl.surface.map import SurfaceMap

PIXEL_MM, DWELL_S, PEAK_NM_S, SIGMA_MM = 0.1, 20.0, 5.0, 0.8
CENTRE_MM = (1.23, -0.77)
VOLUME_NM_MM2_S = 2 * math.pi * SIGMA_MM**2 * PEAK_NM_S


def _maps(noise_nm: float = 0.0, squeeze: float = 1.0) -> tuple[SurfaceMap, SurfaceMap]:
    random = np.random.default_rng(2)
    before = SurfaceMap.centred(30 * random.normal(size=(121, 141)).cumsum(axis=0).cumsum(axis=1) / 1e3, PIXEL_MM)
    x_mm, y_mm = np.meshgrid(before.x_mm - CENTRE_MM[0], before.y_mm - CENTRE_MM[1])
    removed = PEAK_NM_S * DWELL_S * np.exp(-((x_mm * squeeze) ** 2 + y_mm**2) / (2 * SIGMA_MM**2))
    drift = 7.0 + 0.8 * x_mm - 0.5 * y_mm
    noise = noise_nm * random.normal(size=removed.shape)
    return before, replace(before, height_nm=before.height_nm - removed + drift + noise)


def test_a_tool_is_found_where_it_stood_whatever_the_maps_tilt() -> None:
    found = footprint(*_maps(), DWELL_S)
    assert (found.x_mm, found.y_mm) == pytest.approx(CENTRE_MM, abs=0.01)
    assert found.influence.peak_rate_nm_s == pytest.approx(PEAK_NM_S, rel=2e-3)
    assert found.influence.volume_rate_nm_mm2_s == pytest.approx(VOLUME_NM_MM2_S, rel=5e-3)
    assert found.radius_mm == pytest.approx(SIGMA_MM * math.sqrt(2 * math.log(500)), rel=0.1)
    rate = found.influence.rate_nm_s
    np.testing.assert_allclose(rate, rate[::-1, ::-1], atol=0.01 * PEAK_NM_S)
    assert rate[0, 0] == 0.0
    assert not found.noise_dominates


def test_noise_is_told_and_its_error_of_the_volume_is_what_it_is() -> None:
    before, after = _maps(noise_nm=3.0)
    found = footprint(before, after, DWELL_S)
    assert found.noise_nm == pytest.approx(3.0, rel=0.05)
    assert found.influence.volume_rate_nm_mm2_s == pytest.approx(
        VOLUME_NM_MM2_S, abs=4 * found.volume_error * VOLUME_NM_MM2_S + 0.01 * VOLUME_NM_MM2_S
    )
    random = np.random.default_rng(8)
    rates = []
    for _ in range(60):
        noisy = replace(after, height_nm=_maps()[1].height_nm + 3.0 * random.normal(size=after.height_nm.shape))
        rates.append(footprint(before, noisy, DWELL_S, radius_mm=2.5).influence.volume_rate_nm_mm2_s)
    error = footprint(before, after, DWELL_S, radius_mm=2.5).volume_error
    assert np.std(rates) / VOLUME_NM_MM2_S == pytest.approx(error, rel=0.5)


def test_a_tool_that_is_lost_in_noise_says_so() -> None:
    assert footprint(*_maps(noise_nm=30.0), DWELL_S, radius_mm=2.5).noise_dominates
    before, _ = _maps()
    blank = replace(before, height_nm=before.height_nm + np.random.default_rng(1).normal(size=before.height_nm.shape))
    with pytest.raises(InputError, match=r"nothing stands out|reaches pixels|fills the maps"):
        footprint(before, blank, DWELL_S)


def test_a_long_footprint_is_kept_whole() -> None:
    found = footprint(*_maps(squeeze=2.0), DWELL_S)
    assert found.influence.volume_rate_nm_mm2_s == pytest.approx(VOLUME_NM_MM2_S / 2, rel=0.01)


def test_pixels_without_data_matter_only_inside_the_footprint() -> None:
    before, after = _maps()
    holes = after.height_nm.copy()
    holes[:20, :30] = np.nan
    found = footprint(before, replace(after, height_nm=holes), DWELL_S)
    assert found.influence.volume_rate_nm_mm2_s == pytest.approx(VOLUME_NM_MM2_S, rel=5e-3)
    holes[55, 80] = np.nan
    with pytest.raises(InputError, match="pixels without data"):
        footprint(before, replace(after, height_nm=holes), DWELL_S)


def test_what_makes_no_footprint_is_refused() -> None:
    before, after = _maps()
    with pytest.raises(InputError, match="--dwell-s"):
        footprint(before, after, 0.0)
    with pytest.raises(InputError, match="--radius-mm"):
        footprint(before, after, DWELL_S, radius_mm=0.05)
    with pytest.raises(InputError, match="not of the same pixels"):
        footprint(before, replace(after, x0_mm=after.x0_mm + 0.05), DWELL_S)
    with pytest.raises(InputError, match="not of the same pixels"):
        footprint(before, SurfaceMap.centred(after.height_nm[1:], PIXEL_MM), DWELL_S)
    with pytest.raises(InputError, match="fills the maps"):
        footprint(before, after, DWELL_S, radius_mm=9.0)
    left = replace(before, height_nm=before.height_nm + np.where(np.arange(141) > 70, np.nan, 0.0))
    right = replace(after, height_nm=after.height_nm + np.where(np.arange(141) <= 70, np.nan, 0.0))
    with pytest.raises(InputError, match="no valid pixel in common"):
        footprint(left, right, DWELL_S)
