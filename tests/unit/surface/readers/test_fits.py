from pathlib import Path

import numpy as np
import pytest

from ibfctl.errors import InputError
from ibfctl.surface.readers import read_influence, read_map
from tests.support.map_files import hill_nm, write_fits

MM = {"CUNIT1": "mm", "CUNIT2": "mm"}


@pytest.mark.parametrize("bitpix", [-32, -64])
def test_floating_point_heights(tmp_path: Path, bitpix: int) -> None:
    path = write_fits(tmp_path / "m.fits", hill_nm(), bitpix, BUNIT="nm", CDELT1=0.5, CDELT2=0.5, **MM)
    surface = read_map(path)
    np.testing.assert_array_equal(surface.height_nm, hill_nm())
    assert surface.pixel_mm == 0.5
    assert surface.x0_mm == -1.5


@pytest.mark.parametrize(("bitpix", "blank"), [(8, 255), (16, -32768), (32, -1), (64, -(2**40))])
def test_whole_numbers_are_scaled_and_blank_is_no_data(tmp_path: Path, bitpix: int, blank: int) -> None:
    stored = np.where(np.isnan(hill_nm()), blank, np.rint(2 * (hill_nm() + 9)))
    path = write_fits(tmp_path / "m.fits", stored, bitpix, BLANK=blank, BSCALE=5.0e-10, BZERO=-9.0e-9, BUNIT="m")
    height_nm = read_map(path, pixel_mm=1.0).height_nm
    np.testing.assert_allclose(height_nm, np.rint(2 * (hill_nm() + 9)) / 2 - 9, atol=1e-9)


def test_coordinates_place_the_map_on_the_part(tmp_path: Path) -> None:
    place = {"CRPIX1": 2.0, "CRVAL1": 10.0, "CRPIX2": 1.0, "CRVAL2": -4.0, "CDELT1": 200.0, "CDELT2": 200.0}
    path = write_fits(tmp_path / "m.fit", hill_nm(), -64, BUNIT="nm", CUNIT1="um", CUNIT2="um", **place)
    surface = read_map(path)
    assert surface.pixel_mm == pytest.approx(0.2)
    assert (surface.x0_mm, surface.y0_mm) == pytest.approx((-0.19, -0.004))


def test_axes_that_count_downwards_are_turned(tmp_path: Path) -> None:
    place = {"CRPIX1": 1.0, "CRVAL1": 3.0, "CRPIX2": 1.0, "CRVAL2": 2.0, "CDELT1": -0.5, "CDELT2": -0.5}
    surface = read_map(write_fits(tmp_path / "m.fits", hill_nm(), -64, BUNIT="nm", **place, **MM))
    np.testing.assert_array_equal(surface.height_nm, hill_nm()[::-1, ::-1])
    assert (surface.x_mm[-1], surface.y_mm[-1]) == (3.0, 2.0)


def test_an_influence_function(tmp_path: Path) -> None:
    path = write_fits(tmp_path / "t.fits", np.ones((3, 3)), -32, BUNIT="nm s-1", CDELT1=1.0, CDELT2=1.0, **MM)
    assert read_influence(path).peak_rate_nm_s == 1.0
    with pytest.raises(InputError, match="unknown unit 'nm/s' of height"):
        read_map(path)


@pytest.mark.parametrize(
    ("cards", "options", "message"),
    [
        ({}, {"pixel_mm": 1.0}, "--map-unit"),
        ({"BUNIT": "nm"}, {}, "--map-pixel-mm"),
        ({"BUNIT": "adu"}, {"pixel_mm": 1.0}, "unknown unit 'adu'"),
        ({"BUNIT": "nm", "CDELT1": 0.1, "CDELT2": 0.1, "CUNIT1": "deg", "CUNIT2": "deg"}, {}, "--map-pixel-mm"),
        ({"BUNIT": "nm", "CDELT1": 0.1, "CDELT2": 0.1, "CROTA2": 5.0, **MM}, {}, "--map-pixel-mm"),
        ({"BUNIT": "nm", "CDELT1": 0.1, "CDELT2": 0.2, **MM}, {}, "not square"),
        ({"BUNIT": "nm", "CDELT1": 0.0, "CDELT2": 0.0, **MM}, {}, "must be positive"),
        ({"BUNIT": "nm", "BSCALE": "two"}, {"pixel_mm": 1.0}, "BSCALE in its header is no number"),
        ({"BUNIT": "nm", "BSCALE": float("inf")}, {"pixel_mm": 1.0}, "BSCALE in its header is inf"),
        ({"NAXIS": 1, "BUNIT": "nm"}, {"pixel_mm": 1.0}, "no image of two dimensions"),
        ({"NAXIS": 3, "NAXIS3": 2, "BUNIT": "nm"}, {"pixel_mm": 1.0}, "no image of two dimensions"),
        ({"NAXIS1": -7, "BUNIT": "nm"}, {"pixel_mm": 1.0}, "no image of two dimensions"),
        ({"NAXIS1": 10**9, "BUNIT": "nm"}, {"pixel_mm": 1.0}, "declares 5 x 1000000000 pixels"),
        ({"NAXIS1": 7000, "BUNIT": "nm"}, {"pixel_mm": 1.0}, "is cut short"),
    ],
)
def test_what_cannot_be_trusted_is_refused(
    tmp_path: Path, cards: dict[str, object], options: dict[str, float], message: str
) -> None:
    path = write_fits(tmp_path / "m.fits", hill_nm(), -64, **cards)
    with pytest.raises(InputError, match=message) as refusal:
        read_map(path, **options)
    assert str(path) in str(refusal.value)


def test_foreign_files_and_headers_without_an_end_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.fits"
    path.write_bytes(bytes(2880))
    with pytest.raises(InputError, match="is no FITS file"):
        read_map(path)
    path.write_bytes(b"SIMPLE  =".ljust(2880 * 300))
    with pytest.raises(InputError, match="does not end"):
        read_map(path)
