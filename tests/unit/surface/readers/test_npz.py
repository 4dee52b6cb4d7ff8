import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from ibfctl.errors import InputError
from ibfctl.surface.readers import read_influence, read_map


def _save(path: Path, **arrays: object) -> Path:
    np.savez(path, **arrays)
    return path


def test_heights_pixel_and_origin_are_taken_as_written(tmp_path: Path) -> None:
    height = np.arange(12.0).reshape(3, 4)
    surface = read_map(_save(tmp_path / "m.npz", height_nm=height, pixel_mm=0.5, x0_mm=-3.0, y0_mm=7.0))
    np.testing.assert_array_equal(surface.height_nm, height)
    assert (surface.pixel_mm, surface.x0_mm, surface.y0_mm) == (0.5, -3.0, 7.0)


def test_a_map_without_origin_is_centred(tmp_path: Path) -> None:
    surface = read_map(_save(tmp_path / "m.npz", height_nm=np.zeros((3, 5)), pixel_mm=2.0))
    assert (surface.x0_mm, surface.y0_mm) == (-4.0, -2.0)


def test_a_unit_in_the_name_is_converted(tmp_path: Path) -> None:
    surface = read_map(_save(tmp_path / "m.npz", height_um=np.full((2, 2), 0.25), pixel_mm=1.0))
    np.testing.assert_allclose(surface.height_nm, 250.0)


def test_islands_without_data_are_kept(tmp_path: Path) -> None:
    height = np.ones((6, 6))
    height[2:4, 2:4] = np.nan
    surface = read_map(_save(tmp_path / "m.npz", height_nm=height, pixel_mm=1.0))
    assert np.isnan(surface.height_nm).sum() == 4


def test_an_influence_function_is_read(tmp_path: Path) -> None:
    influence = read_influence(_save(tmp_path / "t.npz", rate_nm_s=np.ones((3, 3)), pixel_mm=0.5))
    assert influence.volume_rate_nm_mm2_s == pytest.approx(9 * 0.25)


def test_what_the_file_lacks_may_be_given(tmp_path: Path) -> None:
    path = _save(tmp_path / "m.npz", height=np.full((2, 2), 3.0))
    surface = read_map(path, pixel_mm=0.1, height_unit="um")
    assert surface.pixel_mm == 0.1
    np.testing.assert_allclose(surface.height_nm, 3000.0)


@pytest.mark.parametrize(
    ("arrays", "options", "message"),
    [
        ({"height": np.ones((2, 2)), "pixel_mm": 1.0}, {}, "--map-unit"),
        ({"height_nm": np.ones((2, 2))}, {}, "--map-pixel-mm"),
        ({"height_nm": np.ones((2, 2)), "pixel_mm": 0.0}, {}, "must be positive"),
        ({"height_nm": np.ones((2, 2)), "pixel_mm": -0.1}, {}, "must be positive"),
        ({"height_nm": np.ones((2, 2)), "pixel_mm": np.nan}, {}, "finite"),
        ({"height_nm": np.ones((2, 2)), "pixel_mm": np.ones(2)}, {}, "single number"),
        ({"height_nm": np.ones((2, 2)), "pixel_mm": 1.0}, {"pixel_mm": 0.5}, "--map-pixel-mm says 0.5 mm"),
        ({"height_nm": np.ones((2, 2)), "pixel_mm": 1.0}, {"height_unit": "um"}, "--map-unit says um"),
        ({"height_nm": np.ones((2, 2)), "height_um": np.ones((2, 2)), "pixel_mm": 1.0}, {}, "exactly one"),
        ({"height_ft": np.ones((2, 2)), "pixel_mm": 1.0}, {}, "unknown unit 'ft'"),
        ({"pixel_mm": 1.0}, {}, "exactly one array named like height_nm"),
        ({"height_nm": np.full((2, 2), np.nan), "pixel_mm": 1.0}, {}, "no valid pixel"),
        ({"height_nm": np.array([[1.0, np.inf], [0, 0]]), "pixel_mm": 1.0}, {}, "infinite"),
        ({"height_nm": np.ones(4), "pixel_mm": 1.0}, {}, "two dimensions"),
        ({"height_nm": np.ones((1, 4)), "pixel_mm": 1.0}, {}, "at least 2 x 2"),
        ({"height_nm": np.ones((2, 2), dtype=complex), "pixel_mm": 1.0}, {}, "real numbers"),
        ({"height_nm": np.ones((2, 2)), "pixel_mm": 1.0, "x0_mm": 0.0}, {}, "only one of"),
        ({"height_m": np.array([[0.0, 1.0], [0, 0]]), "pixel_mm": 1.0}, {}, "units are probably mixed up"),
    ],
)
def test_a_map_that_cannot_be_trusted_is_refused_with_its_name(
    tmp_path: Path, arrays: dict[str, object], options: dict[str, object], message: str
) -> None:
    path = _save(tmp_path / "m.npz", **arrays)
    with pytest.raises(InputError) as refusal:
        read_map(path, **options)
    assert message in str(refusal.value)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_pickled_objects_are_refused_unopened(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return Path.touch, (tmp_path / "exploded",)

    path = _save(tmp_path / "m.npz", height_nm=np.array([[Bomb()]], dtype=object), pixel_mm=1.0)
    with pytest.raises(InputError, match="real numbers"):
        read_map(path)
    assert not (tmp_path / "exploded").exists()


def test_a_declared_size_beyond_the_limit_is_refused_before_it_is_allocated(tmp_path: Path) -> None:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
    )
    path = tmp_path / "m.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("height_nm.npy", header.getvalue())
    with pytest.raises(InputError, match="declares 1000000 x 1000000 pixels"):
        read_map(path)


def test_cut_and_damaged_archives_are_refused(tmp_path: Path) -> None:
    path = _save(tmp_path / "m.npz", height_nm=np.ones((50, 50)), pixel_mm=1.0)
    whole = path.read_bytes()
    damaged = bytearray(whole)
    damaged[1000:1100] = bytes(100)
    for content in (b"", whole[:100], whole[: len(whole) // 2], bytes(damaged), b"not a zip at all"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"no readable \.npz archive"):
            read_map(path)
