from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ibfctl.errors import InputError
from ibfctl.surface.readers import read_map
from tests.support.map_files import hill_nm, write_tiff

GIVEN = {"pixel_mm": 0.5, "height_unit": "nm"}
BYTE, SHORT, LONG, UNDEFINED = 1, 3, 4, 7


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("dtype", ["f4", "f8", "i2", "u2", "i4", "u1"])
@pytest.mark.parametrize("parts", [{}, {"rows_per_strip": 2}, {"tile": (16, 16)}, {"tile": (2, 3)}])
def test_every_kind_of_number_and_of_parts(
    tmp_path: Path, order: str, dtype: str, parts: dict[str, object]
) -> None:
    stored = np.arange(35.0).reshape(5, 7).astype(dtype)
    surface = read_map(write_tiff(tmp_path / "m.tif", stored, order=order, **parts), **GIVEN)
    np.testing.assert_array_equal(surface.height_nm, stored[::-1])
    assert surface.pixel_mm == 0.5


def test_nan_is_no_data_and_the_lower_left_may_come_first(tmp_path: Path) -> None:
    path = write_tiff(tmp_path / "m.tiff", hill_nm(), tag_274=(SHORT, 4))
    np.testing.assert_array_equal(read_map(path, **GIVEN).height_nm, hill_nm())


@pytest.mark.parametrize("mode", ["F", "I", "I;16"])
def test_what_another_program_writes(tmp_path: Path, mode: str) -> None:
    stored = np.arange(35).reshape(5, 7).astype({"F": "f4", "I": "i4", "I;16": "u2"}[mode])
    Image.fromarray(stored).save(tmp_path / "m.tif")
    np.testing.assert_array_equal(read_map(tmp_path / "m.tif", **GIVEN).height_nm, stored[::-1])


def test_a_value_that_is_marked_as_no_data(tmp_path: Path) -> None:
    image = Image.fromarray(np.array([[1, 2], [-99, 4]], dtype=np.int32))
    image.save(tmp_path / "m.tif", tiffinfo={42113: "-99"})
    np.testing.assert_array_equal(read_map(tmp_path / "m.tif", **GIVEN).height_nm, [[np.nan, 4], [1, 2]])


def test_unit_and_pixel_size_must_be_given(tmp_path: Path) -> None:
    path = write_tiff(tmp_path / "m.tif", hill_nm())
    with pytest.raises(InputError, match="--map-unit"):
        read_map(path, pixel_mm=0.5)
    with pytest.raises(InputError, match="--map-pixel-mm"):
        read_map(path, height_unit="um")
    assert read_map(path, pixel_mm=0.5, height_unit="um").height_nm[0, 0] == 1e3 * hill_nm()[-1, 0]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"tag_259": (SHORT, 5)}, "its compression cannot be read"),
        ({"tag_277": (SHORT, 3)}, "its samples per pixel cannot be read"),
        ({"tag_262": (SHORT, 0)}, "its colours cannot be read"),
        ({"tag_274": (SHORT, 6)}, "its orientation cannot be read"),
        ({"tag_258": (SHORT, 12)}, r"its kind of numbers \(12 bits\) cannot be read"),
        ({"tag_339": (SHORT, 6)}, "its kind of numbers"),
        ({"tag_278": (LONG, 1)}, "do not make up 5 x 7 pixels"),
        ({"tag_278": (LONG, 0)}, "do not make up"),
        ({"tag_257": (LONG, 0)}, "do not make up"),
        ({"tag_256": (UNDEFINED, 7)}, "do not make up"),
        ({"tag_256": (LONG, 2**31), "tag_257": (LONG, 2**31)}, "declares 2147483648 x 2147483648 pixels"),
        ({"tag_256": (LONG, 8000), "tag_257": (LONG, 8000), "tag_278": (LONG, 8000)}, "is cut short"),
        ({"tag_273": (LONG, 2**32 - 1)}, "is cut short"),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path: Path, changed: dict[str, tuple[int, int]], message: str) -> None:
    path = write_tiff(tmp_path / "m.tif", hill_nm(), **changed)
    with pytest.raises(InputError, match=message) as refusal:
        read_map(path, **GIVEN)
    assert str(path) in str(refusal.value)


def test_compressed_and_coloured_images_of_another_program_are_refused(tmp_path: Path) -> None:
    image = Image.fromarray(np.ones((5, 7), dtype=np.float32))
    image.save(tmp_path / "m.tif", compression="tiff_lzw")
    with pytest.raises(InputError, match="compression"):
        read_map(tmp_path / "m.tif", **GIVEN)
    Image.new("RGB", (7, 5)).save(tmp_path / "m.tif")
    with pytest.raises(InputError, match=r"samples per pixel|must be one number"):
        read_map(tmp_path / "m.tif", **GIVEN)
    image.save(tmp_path / "m.tif", save_all=True, append_images=[image])
    with pytest.raises(InputError, match="more than one image"):
        read_map(tmp_path / "m.tif", **GIVEN)
