"""Power spectral densities: what is summed up is the mean square, and waves are where they belong."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from ibfctl.surface.psd import psd_along, psd_radial

PIXEL_MM = 0.2
RANDOM = np.random.default_rng(8)


@pytest.mark.parametrize("shape", [(40, 60), (41, 60), (17, 90), (33, 33)])
@pytest.mark.parametrize("masked", [False, True])
def test_density_times_weight_sums_up_to_the_mean_square(shape: tuple[int, int], masked: bool) -> None:
    height_nm = RANDOM.normal(0.3, 2.0, shape)
    if masked:
        y, x = np.indices(shape)
        height_nm[np.hypot((y - shape[0] / 2) / shape[0], (x - shape[1] / 2) / shape[1]) > 0.4] = np.nan
    square = float(np.nanmean(height_nm**2))
    for spectrum in (
        psd_along(height_nm, PIXEL_MM, "x"),
        psd_along(height_nm, PIXEL_MM, "y"),
        psd_radial(height_nm, PIXEL_MM),
    ):
        assert (spectrum.density * spectrum.weight).sum() == pytest.approx(square)
        assert spectrum.frequency_per_mm[0] == 0.0
        assert (np.diff(spectrum.frequency_per_mm) > 0).all()


@pytest.mark.parametrize("coordinate", ["x", "y"])
def test_a_wave_of_one_nanometre_is_half_a_square_nanometre_at_its_frequency(coordinate: Literal["x", "y"]) -> None:
    place_mm = PIXEL_MM * np.arange(100)
    wave = np.sin(2 * np.pi * 0.5 * place_mm)
    height_nm = np.tile(wave, (40, 1))
    spectrum = psd_along(height_nm if coordinate == "x" else height_nm.T, PIXEL_MM, coordinate)
    share = spectrum.density * spectrum.weight
    peak = int(np.argmax(share))
    assert spectrum.frequency_per_mm[peak] == pytest.approx(0.5)
    assert share[peak] == pytest.approx(0.5)
    # A density: a length of 20 mm resolves 0.05 per mm.
    assert spectrum.density[peak] == pytest.approx(0.5 / 0.05)
    across = psd_along(height_nm.T if coordinate == "x" else height_nm, PIXEL_MM, coordinate)
    assert (across.density * across.weight)[1:].sum() < 1e-12


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 2])
def test_a_wave_in_any_direction_is_in_the_ring_of_its_frequency(angle: float) -> None:
    y_mm, x_mm = PIXEL_MM * np.indices((200, 240))
    height_nm = np.sin(2 * np.pi * 0.8 * (x_mm * np.cos(angle) + y_mm * np.sin(angle)))
    spectrum = psd_radial(height_nm, PIXEL_MM)
    share = spectrum.density * spectrum.weight
    assert share[np.abs(spectrum.frequency_per_mm - 0.8) < 0.1].sum() > 0.95 * share.sum()


def test_white_noise_has_the_same_density_everywhere_and_pixels_without_data_do_not_matter() -> None:
    height_nm = RANDOM.normal(0, 3.0, (300, 400))
    height_nm[:, 100:160] = np.nan
    for spectrum, expected in (
        (psd_along(height_nm, PIXEL_MM, "x"), 2 * 9 * PIXEL_MM),
        (psd_along(height_nm, PIXEL_MM, "y"), 2 * 9 * PIXEL_MM),
        (psd_radial(height_nm, PIXEL_MM), 9 * PIXEL_MM**2),
    ):
        middle = slice(spectrum.density.size // 4, -spectrum.density.size // 4)
        assert spectrum.density[middle].mean() == pytest.approx(expected, rel=0.03)


def test_the_density_of_a_bow_on_a_long_strip_falls_from_ring_to_ring() -> None:
    _, x_mm = PIXEL_MM * np.indices((40, 230))
    spectrum = psd_radial((x_mm - x_mm.mean()) ** 2, PIXEL_MM)
    within = spectrum.frequency_per_mm < 0.5 / PIXEL_MM
    assert (np.diff(spectrum.density[within][1:]) < 0).all()


def test_a_rim_without_data_changes_nothing() -> None:
    height_nm = RANDOM.normal(size=(30, 50))
    framed = np.pad(height_nm, 7, constant_values=np.nan)
    for one, other in (
        (psd_along(height_nm, PIXEL_MM, "y"), psd_along(framed, PIXEL_MM, "y")),
        (psd_radial(height_nm, PIXEL_MM), psd_radial(framed, PIXEL_MM)),
    ):
        np.testing.assert_allclose(one.density, other.density)
        np.testing.assert_allclose(one.frequency_per_mm, other.frequency_per_mm)
