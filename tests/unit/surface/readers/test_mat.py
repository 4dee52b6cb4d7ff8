import struct
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
from scipy import io

from ibfctl.errors import InputError
from ibfctl.surface.readers import read_influence, read_map


def _arrays(ny: int = 4, nx: int = 6, pixel_m: float = 1e-4) -> dict[str, np.ndarray]:
    x, y = np.meshgrid(pixel_m * np.arange(nx), pixel_m * np.arange(ny))
    z = 1e-9 * np.arange(float(ny * nx)).reshape(ny, nx)
    return {"X": x, "Y": y, "Z": z, "pixel_m": np.array(pixel_m)}


def _save(path: Path, arrays: dict[str, np.ndarray], compressed: bool = True) -> Path:
    io.savemat(path, arrays, do_compression=compressed)
    return path


@pytest.mark.parametrize("compressed", [True, False])
def test_metres_become_mm_and_nm(tmp_path: Path, compressed: bool) -> None:
    surface = read_map(_save(tmp_path / "m.mat", _arrays(), compressed))
    np.testing.assert_allclose(surface.height_nm, np.arange(24.0).reshape(4, 6))
    assert surface.pixel_mm == pytest.approx(0.1)
    assert (surface.x0_mm, surface.y0_mm) == (0.0, 0.0)


def test_what_is_to_be_removed_comes_before_the_surface_unless_chosen(tmp_path: Path) -> None:
    arrays = _arrays()
    path = _save(tmp_path / "m.mat", arrays | {"Z_to_remove": arrays["Z"] + 5e-9})
    assert read_map(path).height_nm[0, 0] == pytest.approx(5.0)
    assert read_map(path, array="Z").height_nm[0, 0] == 0.0
    with pytest.raises(InputError, match="has no array Q, it holds X, Y, Z, Z_to_remove, pixel_m"):
        read_map(path, array="Q")


def test_orientations_of_the_grid_are_put_in_order(tmp_path: Path) -> None:
    arrays = _arrays()
    expected = read_map(_save(tmp_path / "m.mat", arrays)).height_nm
    flipped = {key: value[::-1] if value.ndim == 2 else value for key, value in arrays.items()}
    np.testing.assert_array_equal(read_map(_save(tmp_path / "f.mat", flipped)).height_nm, expected)
    transposed = {key: value.T for key, value in arrays.items()}
    np.testing.assert_array_equal(read_map(_save(tmp_path / "t.mat", transposed)).height_nm, expected)


def test_an_influence_function_is_in_metres_per_second(tmp_path: Path) -> None:
    arrays = _arrays(5, 5)
    arrays |= {"X": arrays["X"] - 2e-4, "Y": arrays["Y"] - 2e-4, "Z": np.full((5, 5), 2e-9)}
    influence = read_influence(_save(tmp_path / "t.mat", arrays))
    assert influence.peak_rate_nm_s == pytest.approx(2.0)


def test_pixel_size_alone_gives_a_centred_map(tmp_path: Path) -> None:
    arrays = _arrays()
    path = _save(tmp_path / "m.mat", {"Z": arrays["Z"], "m_per_pixel": np.array(1e-3)})
    surface = read_map(path)
    assert (surface.pixel_mm, surface.x0_mm) == (1.0, -2.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pixel_m": np.array(0.1)}, "pixel size more than once: 0.1 mm and 100 mm"),
        ({"Z": np.ones((4, 6)) * 1j}, "real numbers"),
        ({"Z": np.ones((3, 6))}, "different shapes"),
        ({"X": np.random.default_rng(1).normal(size=(4, 6))}, "no rectangular grid"),
        ({"Y": 2 * _arrays()["Y"]}, "not square"),
        ({"Z": np.array("text")}, "Z: "),
        ({"Z": np.arange(24.0).reshape(4, 6)}, "units are probably mixed up"),
    ],
)
def test_a_file_that_contradicts_itself_is_refused(tmp_path: Path, change: dict[str, np.ndarray], message: str) -> None:
    path = _save(tmp_path / "m.mat", _arrays() | change)
    with pytest.raises(InputError) as refusal:
        read_map(path)
    assert message in str(refusal.value)
    assert str(path) in str(refusal.value)


def test_a_file_without_pixel_size_needs_it_given(tmp_path: Path) -> None:
    path = _save(tmp_path / "m.mat", {"Z": _arrays()["Z"]})
    with pytest.raises(InputError, match="--map-pixel-mm"):
        read_map(path)
    assert read_map(path, pixel_mm=0.25).pixel_mm == 0.25


def test_cut_and_foreign_files_are_refused(tmp_path: Path) -> None:
    path = _save(tmp_path / "m.mat", _arrays(60, 60))
    whole = path.read_bytes()
    for content in (
        b"",
        whole[:64],
        whole[:140],
        whole[: len(whole) // 2],
        b"\x89HDF\r\n\x1a\n" + bytes(600),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError):
            read_map(path)


def test_a_small_file_that_unpacks_to_gigabytes_is_not_unpacked(tmp_path: Path) -> None:
    def element(kind: int, content: bytes) -> bytes:
        return struct.pack("<II", kind, len(content)) + content.ljust(-(-len(content) // 8) * 8, b"\0")

    double, gigabytes = 6, 3 << 30
    head = element(6, struct.pack("<II", double, 0)) + element(5, struct.pack("<ii", 4, 5)) + element(1, b"Z")
    packer = zlib.compressobj(9)
    matrix = struct.pack("<II", 14, len(head) + 8 + gigabytes) + head + struct.pack("<II", 9, gigabytes)
    packed = b"".join([packer.compress(matrix), *(packer.compress(bytes(1 << 24)) for _ in range(20)), packer.flush()])
    path = _save(tmp_path / "m.mat", {"A": np.ones(1)})
    path.write_bytes(path.read_bytes()[:128] + struct.pack("<II", 15, len(packed)) + packed)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="is cut short"):
            read_map(path, pixel_mm=1.0)
        assert tracemalloc.get_traced_memory()[1] < 1 << 22
    finally:
        tracemalloc.stop()


def test_what_else_the_file_holds_is_named(tmp_path: Path) -> None:
    path = _save(tmp_path / "m.mat", {"Z": np.ones((3, 3)), "text": "abc", "cell": np.array([[1, "b"]], dtype=object)})
    with pytest.raises(InputError, match="it holds Z, cell, text"):
        read_map(path, array="absent")
    with pytest.raises(InputError, match="real numbers"):
        read_map(path, array="text")


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("dtype", ["f4", "f8", "i1", "u1", "i2", "u2", "i4", "u4"])
def test_every_kind_of_number(tmp_path: Path, dtype: str, compressed: bool) -> None:
    path = tmp_path / "m.mat"
    io.savemat(path, {"before": np.eye(3), "Z": np.arange(12).reshape(3, 4).astype(dtype)}, do_compression=compressed)
    height_nm = read_map(path, pixel_mm=1.0, height_unit="nm").height_nm
    np.testing.assert_array_equal(height_nm, np.arange(12.0).reshape(3, 4))
