from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.errors import InputError
from ibfctl.surface.readers import MAP_SUFFIXES, read_influence, read_map

HDF5 = {".h5", ".hdf5", ".datx"}  # each takes a process of its own: see test_hostile_files
GAUSSIAN = "gaussian:fwhm_mm=1.9625,peak_nm_s=10,radius_mm=2.5"


def test_a_formula_makes_a_finely_sampled_influence_function() -> None:
    influence = read_influence(GAUSSIAN)
    assert influence.pixel_mm == pytest.approx(0.05)
    assert influence.peak_rate_nm_s == 10.0
    assert influence.radius_mm == pytest.approx(2.5)
    sigma_mm = 1.9625 / np.sqrt(8 * np.log(2))
    inside = 2 * np.pi * sigma_mm**2 * 10 * (1 - np.exp(-(2.5**2) / (2 * sigma_mm**2)))
    assert influence.volume_rate_nm_mm2_s == pytest.approx(inside, rel=2e-4)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("gaussian:", "not expected"),
        ("gaussian:fwhm_mm=2", "peak_nm_s, radius_mm missing"),
        (GAUSSIAN + ",fwhm_mm=2", "not expected"),
        (GAUSSIAN + ",sigma=2", "not expected"),
        (GAUSSIAN.replace("10", "ten"), "peak_nm_s is no number"),
        (GAUSSIAN.replace("10", "-10"), "must be positive"),
        (GAUSSIAN.replace("2.5", "0"), "must be positive"),
        (GAUSSIAN.replace("2.5", "nan"), "must be positive"),
    ],
)
def test_a_wrong_formula_is_refused(spec: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_influence(spec)


@pytest.mark.parametrize("pixel_mm", [0.0, -1.0, float("nan"), float("inf"), 1e-9])
def test_a_formula_is_not_sampled_on_an_absurd_pitch(pixel_mm: float) -> None:
    with pytest.raises(InputError, match=r"does not suit|must be positive"):
        read_influence(GAUSSIAN, pixel_mm=pixel_mm)


def test_unknown_suffix_absent_file_and_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"unknown kind of file '\.docx'"):
        read_map(tmp_path / "m.docx")
    with pytest.raises(InputError, match="cannot be read"):
        read_map(tmp_path / "absent.npz")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        read_map(tmp_path / "folder.csv")
    with pytest.raises(InputError, match=r"only \.mat, \.h5, \.hdf5, \.datx files"):
        read_map(tmp_path / "m.npz", array="Z")


@settings(max_examples=150, deadline=None)
@given(suffix=st.sampled_from(sorted({*MAP_SUFFIXES} - HDF5)), content=st.binary(max_size=400))
def test_no_content_whatever_raises_anything_but_an_input_error(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / f"foreign{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError):
        read_map(path)
