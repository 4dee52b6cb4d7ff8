from pathlib import Path

import numpy as np
import prysm.io
import pytest

from ibfctl.errors import InputError
from ibfctl.surface.readers import read_influence, read_map
from tests.support.map_files import hill_nm, write_metropro


@pytest.mark.parametrize("magic", [0x881B036F, 0x881B0370, 0x881B0371])
@pytest.mark.parametrize(("resolution", "count_nm"), [(0, 0.0773), (1, 0.00966), (2, 0.00242)])
def test_heights_pixel_and_holes_are_taken_as_written(
    tmp_path: Path, magic: int, resolution: int, count_nm: float
) -> None:
    path = write_metropro(tmp_path / "m.dat", hill_nm(), 0.25, magic=magic, resolution=resolution)
    surface = read_map(path)
    np.testing.assert_array_equal(np.isnan(surface.height_nm), np.isnan(hill_nm()))
    np.testing.assert_allclose(surface.height_nm, hill_nm(), atol=count_nm)
    assert surface.pixel_mm == 0.25
    assert surface.x0_mm == -0.75  # centred


@pytest.mark.parametrize("camera", [(0, 0, 0), (9, 8, 1), (9, 8, 5)])
def test_a_second_reader_sees_the_same_heights(tmp_path: Path, camera: tuple[int, int, int]) -> None:
    path = write_metropro(tmp_path / "m.dat", hill_nm(), camera=camera)
    other = prysm.io.read_zygo_dat(path)
    surface = read_map(path)
    np.testing.assert_allclose(surface.height_nm, other["phase"][::-1], rtol=1e-6)  # it leaves the top row first
    assert surface.pixel_mm == pytest.approx(1e3 * other["meta"]["lateral_resolution"], rel=1e-6)


def test_a_camera_without_calibration_needs_the_pixel_size(tmp_path: Path) -> None:
    path = write_metropro(tmp_path / "m.dat", hill_nm(), 0.0)
    with pytest.raises(InputError, match="--map-pixel-mm"):
        read_map(path)
    assert read_map(path, pixel_mm=0.125).pixel_mm == 0.125


def test_a_unit_or_pixel_size_that_contradicts_the_file_is_refused(tmp_path: Path) -> None:
    path = write_metropro(tmp_path / "m.dat", hill_nm(), 0.5)
    with pytest.raises(InputError, match="--map-unit says nm"):
        read_map(path, height_unit="nm")
    with pytest.raises(InputError, match=r"--map-pixel-mm says 0\.4 mm"):
        read_map(path, pixel_mm=0.4)


def test_heights_are_no_rates(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="ibfctl tif"):
        read_influence(write_metropro(tmp_path / "m.dat", hill_nm()))


def test_what_programs_read_differently_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="data sign is inverted"):
        read_map(write_metropro(tmp_path / "m.dat", hill_nm(), inverted=1))


@pytest.mark.parametrize(
    ("at", "content", "message"),
    [
        (0, b"\x88\x1b\x03\x72", "is no MetroPro file"),
        (6, b"\x00\x00\x10\x00", "its header declares 4096 bytes"),
        (68, b"\x00\x00", "holds no phase"),
        (68, b"\xff\xff", "is cut short"),
        (68, b"\xff\xff\xff\xff", "declares 65535 x 65535 pixels"),
        (168, b"\xff\xff\xff\xff", "no height of a fringe"),
        (176, bytes(4), "no height of a fringe"),
        (218, b"\x00\x07", "no height of a fringe"),
        (184, b"\x80\xff\x00\x00", "must be positive"),
    ],
)
def test_a_header_that_makes_no_sense_is_refused(tmp_path: Path, at: int, content: bytes, message: str) -> None:
    path = write_metropro(tmp_path / "m.dat", hill_nm())
    whole = path.read_bytes()
    path.write_bytes(whole[:at] + content + whole[at + len(content) :])
    with pytest.raises(InputError, match=message):
        read_map(path)
