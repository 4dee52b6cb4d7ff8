from pathlib import Path

import h5py
import numpy as np
import prysm.io
import pytest

from ibfctl.errors import InputError
from ibfctl.surface.map import SurfaceMap
from ibfctl.surface.readers import read_map
from ibfctl.surface.writers import write_map
from tests.support.map_files import hill_nm

SURFACE = SurfaceMap(hill_nm(), 0.25, -3.0, 7.0)


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".xyz", ".h5"])
def test_what_is_written_is_read_back(tmp_path: Path, suffix: str) -> None:
    write_map(SURFACE, tmp_path / f"m{suffix}")
    surface = read_map(tmp_path / f"m{suffix}")
    np.testing.assert_array_equal(surface.height_nm, SURFACE.height_nm)
    assert (surface.pixel_mm, surface.x0_mm, surface.y0_mm) == (0.25, -3.0, 7.0)


def test_a_surface_for_mx_is_read_back_and_by_a_second_reader(tmp_path: Path) -> None:
    path = tmp_path / "m.datx"
    write_map(SURFACE, path)
    surface = read_map(path)
    np.testing.assert_array_equal(surface.height_nm, SURFACE.height_nm)
    assert surface.pixel_mm == pytest.approx(0.25)
    other = prysm.io.read_zygo_datx(path)
    np.testing.assert_array_equal(other["phase"][::-1], SURFACE.height_nm)
    assert other["meta"]["Lateral Resolution"] == pytest.approx(0.25e-3)
    with h5py.File(path) as file:
        assert file["MetaData"][-1]["Destination"].decode() in file


def test_an_unknown_suffix_and_an_absent_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"not written as \.bmp"):
        write_map(SURFACE, tmp_path / "m.bmp")
    with pytest.raises(InputError, match="cannot be written"):
        write_map(SURFACE, tmp_path / "absent" / "m.h5")
    assert list(tmp_path.iterdir()) == []
