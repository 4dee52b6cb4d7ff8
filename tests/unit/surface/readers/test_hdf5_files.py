from pathlib import Path

import h5py
import numpy as np
import prysm.io
import pytest

from ibfctl.errors import InputError
from ibfctl.surface.readers import read_influence, read_map
from tests.support.map_files import WAVELENGTH_M, hill_nm, write_datx, write_mat73


def _h5(path: Path, attributes: dict[str, object], **arrays: np.ndarray) -> Path:
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file.create_dataset(name.replace("__", "/"), data=values, compression="gzip", shuffle=True)
        file.attrs.update(attributes)
    return path


def test_a_table_with_its_place(tmp_path: Path) -> None:
    place = {"pixel_mm": 0.5, "x0_mm": -3.0, "y0_mm": 7.0}
    surface = read_map(_h5(tmp_path / "m.h5", place, height_um=hill_nm()))
    np.testing.assert_allclose(surface.height_nm, 1e3 * hill_nm())
    assert (surface.pixel_mm, surface.x0_mm, surface.y0_mm) == (0.5, -3.0, 7.0)


def test_a_chosen_array_with_its_own_unit_and_place(tmp_path: Path) -> None:
    path = _h5(tmp_path / "m.hdf5", {"pixel_mm": 9.0}, as_run__ideal_residual_nm=hill_nm(), height_nm=np.ones((3, 3)))
    with h5py.File(path, "r+") as file:
        file["as_run"].attrs["pixel_mm"] = 0.25
    surface = read_map(path, array="as_run/ideal_residual_nm")
    np.testing.assert_array_equal(surface.height_nm, hill_nm())
    assert surface.pixel_mm == 0.25
    with h5py.File(path, "r+") as file:
        file["as_run/ideal_residual_nm"].attrs["unit"] = "pm"
    np.testing.assert_allclose(read_map(path, array="as_run/ideal_residual_nm").height_nm, hill_nm() / 1e3)


def test_an_influence_function(tmp_path: Path) -> None:
    path = _h5(tmp_path / "t.h5", {"pixel_mm": 0.5}, rate_nm_s=np.ones((3, 3), dtype=np.float32))
    assert read_influence(path).peak_rate_nm_s == 1.0


@pytest.mark.parametrize(
    ("attributes", "arrays", "message"),
    [
        ({}, {"height_nm": hill_nm()}, "--map-pixel-mm"),
        ({"pixel_mm": 1.0}, {"height": hill_nm()}, "--map-unit"),
        ({"pixel_mm": "wide"}, {"height_nm": hill_nm()}, "pixel_mm is no number"),
        ({"pixel_mm": np.inf}, {"height_nm": hill_nm()}, "finite"),
        ({"pixel_mm": 1.0, "x0_mm": 0.0}, {"height_nm": hill_nm()}, "only one of"),
        ({"pixel_mm": 1.0}, {"height_nm": hill_nm(), "height_um": hill_nm()}, "exactly one array"),
        ({"pixel_mm": 1.0}, {"other": hill_nm()}, "it holds other"),
        ({"pixel_mm": 1.0}, {"height_nm": np.ones(4)}, "two dimensions"),
        ({"pixel_mm": 1.0}, {"height_nm": hill_nm().astype(complex)}, "real numbers"),
    ],
)
def test_what_cannot_be_trusted_is_refused(
    tmp_path: Path, attributes: dict[str, object], arrays: dict[str, np.ndarray], message: str
) -> None:
    path = _h5(tmp_path / "m.h5", attributes, **arrays)
    with pytest.raises(InputError, match=message) as refusal:
        read_map(path)
    assert str(path) in str(refusal.value)


def test_values_in_other_files_are_refused(tmp_path: Path) -> None:
    other = _h5(tmp_path / "other.h5", {"pixel_mm": 1.0}, height_nm=hill_nm())
    with h5py.File(tmp_path / "link.h5", "w") as file:
        file["height_nm"] = h5py.ExternalLink(str(other), "height_nm")
    with h5py.File(tmp_path / "raw.h5", "w") as file:
        file.create_dataset("height_nm", (5, 7), "f8", external=[(str(other), 0, 280)])
    layout = h5py.VirtualLayout((5, 7), "f8")
    layout[:] = h5py.VirtualSource(str(other), "height_nm", (5, 7))
    with h5py.File(tmp_path / "virtual.h5", "w") as file:
        file.create_virtual_dataset("height_nm", layout)
    for name in ("link", "raw", "virtual"):
        with pytest.raises(InputError, match="lies in another file"):
            read_map(tmp_path / f"{name}.h5", pixel_mm=1.0)


def test_sizes_that_are_declared_and_not_there_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("height_nm", (9000, 9000), "f8")
    with pytest.raises(InputError, match="declares 9000 x 9000 pixels"):
        read_map(path, pixel_mm=1.0)
    with h5py.File(path, "w") as file:
        chunk = np.zeros((4096, 8192))  # 256 MiB in a chunk of a map of 16 x 16 pixels
        data = file.create_dataset(
            "height_nm", (16, 16), "f8", chunks=chunk.shape, maxshape=(None, None), compression=9
        )
        data[:] = 1.0
    with pytest.raises(InputError, match="no readable HDF5 file"):
        read_map(path, pixel_mm=1.0)


@pytest.mark.parametrize("unit", [b"NanoMeters", b"Fringes"])
def test_a_surface_of_mx_and_what_a_second_reader_sees(tmp_path: Path, unit: bytes) -> None:
    factor = 0.5 * WAVELENGTH_M * 1e9 if unit == b"Fringes" else 1.0
    path = write_datx(tmp_path / "m.datx", hill_nm()[::-1] / factor, 0.25, unit)
    surface = read_map(path)
    np.testing.assert_allclose(surface.height_nm, hill_nm(), rtol=1e-12)
    assert surface.pixel_mm == pytest.approx(0.25)
    other = prysm.io.read_zygo_datx(path)
    np.testing.assert_allclose(surface.height_nm, other["phase"][::-1], rtol=1e-12)  # it leaves the top row first
    assert other["meta"]["Lateral Resolution"] == pytest.approx(surface.pixel_mm / 1e3)


def test_a_surface_of_mx_that_says_too_little(tmp_path: Path) -> None:
    path = write_datx(tmp_path / "m.datx", hill_nm(), 0.0)
    with pytest.raises(InputError, match="--map-pixel-mm"):
        read_map(path)
    assert read_map(path, pixel_mm=0.5).pixel_mm == 0.5
    with h5py.File(path, "r+") as file:
        del file["Data/Surface/{SURFACE}"].attrs["Unit"]
    with pytest.raises(InputError, match="--map-unit"):
        read_map(path, pixel_mm=0.5)
    with h5py.File(path, "r+") as file:
        file["Data/Surface/second"] = hill_nm()
    with pytest.raises(InputError, match="holds 2 surfaces"):
        read_map(path, pixel_mm=0.5, height_unit="nm")
    with pytest.raises(InputError, match="ibfctl tif"):
        read_influence(path)


def test_matlab_of_version_73_is_read_as_of_version_5(tmp_path: Path) -> None:
    x, y = np.meshgrid(5e-4 * np.arange(7), 5e-4 * np.arange(5))
    path = write_mat73(tmp_path / "m.mat", X=x, Y=y, Z=1e-9 * hill_nm(), pixel_m=np.array(5e-4))
    surface = read_map(path)
    np.testing.assert_allclose(surface.height_nm, hill_nm(), rtol=1e-12)
    assert surface.pixel_mm == pytest.approx(0.5)
    with pytest.raises(InputError, match="has no array absent, it holds X, Y, Z, pixel_m"):
        read_map(path, array="absent")
