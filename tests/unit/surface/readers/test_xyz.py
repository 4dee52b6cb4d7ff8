from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.errors import InputError
from ibfctl.surface.readers import read_influence, read_map

GRID = "x_mm,y_mm,height_nm\n0,0,1\n0.5,0,2\n1,0,3\n0,0.5,4\n0.5,0.5,5\n1,0.5,6\n"


def _write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_points_land_on_their_pixels(tmp_path: Path) -> None:
    surface = read_map(_write(tmp_path / "m.csv", GRID))
    np.testing.assert_array_equal(surface.height_nm, [[1, 2, 3], [4, 5, 6]])
    assert (surface.pixel_mm, surface.x0_mm, surface.y0_mm) == (0.5, 0.0, 0.0)


@pytest.mark.parametrize(
    "text",
    [
        GRID.replace(",", ";"),
        GRID.replace(",", "\t"),
        GRID.replace(",", "  "),
        "# " + GRID,
        "\n\n" + GRID,
        "\ufeff" + GRID,
        GRID.replace("x_mm,y_mm,height_nm", "X [mm], Y [mm], Z (nm)"),
        GRID.replace("x_mm,y_mm,height_nm", "# x[mm] y [mm]  z [nm]").replace(",", " "),
        GRID.replace("\n", "\r\n"),
    ],
)
def test_the_usual_ways_to_write_a_table_are_understood(tmp_path: Path, text: str) -> None:
    surface = read_map(_write(tmp_path / "m.xyz", text))
    np.testing.assert_array_equal(surface.height_nm, [[1, 2, 3], [4, 5, 6]])


def test_units_of_the_header_are_converted(tmp_path: Path) -> None:
    text = "x_um,y_um,height_pm\n0,0,1000\n100,0,2000\n0,100,3000\n100,100,4000\n"
    surface = read_map(_write(tmp_path / "m.csv", text))
    assert surface.pixel_mm == pytest.approx(0.1)
    np.testing.assert_allclose(surface.height_nm, [[1, 2], [3, 4]])


def test_absent_points_and_nan_are_no_data(tmp_path: Path) -> None:
    text = GRID.replace("1,0,3\n", "").replace("0.5,0.5,5", "0.5,0.5,nan")
    height = read_map(_write(tmp_path / "m.csv", text)).height_nm
    np.testing.assert_array_equal(np.isnan(height), [[False, False, True], [False, True, False]])


def test_a_table_without_header_needs_both_units(tmp_path: Path) -> None:
    path = _write(tmp_path / "m.xyz", GRID.split("\n", 1)[1].replace(",", " "))
    with pytest.raises(InputError, match="--map-unit"):
        read_map(path)
    with pytest.raises(InputError, match="--map-pixel-mm"):
        read_map(path, height_unit="nm")
    surface = read_map(path, height_unit="um", pixel_mm=2.0)
    assert surface.x_mm[-1] == 4.0
    assert surface.height_nm[1, 2] == 6000.0


def test_an_influence_function_must_be_centred_on_the_origin(tmp_path: Path) -> None:
    rows = [f"{x},{y},{2.0 - abs(x) - abs(y)}" for y in (-1, 0, 1) for x in (-1, 0, 1)]
    path = _write(tmp_path / "t.csv", "\n".join(["x_mm,y_mm,rate_nm_s", *rows]))
    assert read_influence(path).peak_rate_nm_s == 2.0
    shifted = [f"{x + 5},{y},{1.0}" for y in (-1, 0, 1) for x in (-1, 0, 1)]
    _write(path, "\n".join(["x_mm,y_mm,rate_nm_s", *shifted]))
    with pytest.raises(InputError, match="its centre is at x 5 mm, y 0 mm"):
        read_influence(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no rows"),
        ("x_mm,y_mm,height_nm\n", "holds 0 points"),
        (GRID.replace("y_mm", "y_m"), "mixed units, x is in mm and y in m"),
        (GRID.replace("x_mm", "x_parsec").replace("y_mm", "y_parsec"), "unknown unit 'parsec'"),
        (GRID.replace("height_nm", "height"), "--map-unit"),
        (GRID.replace("x_mm", "x").replace("y_mm", "y"), "--map-pixel-mm"),
        (GRID.replace("height_nm", "temperature"), "exactly one column height or z"),
        (GRID.replace("0.5,0,2", "0.61,0,2"), "not on a uniform grid"),
        (GRID.replace("1,0,3", "0.5,0,3"), "two values for one point"),
        (GRID.replace(",0.5,", ",0.4,"), "not square"),
        (GRID.replace("0.5,0,2", "0.5,0,two"), "two"),
        (GRID.replace("0.5,0,2", "nan,0,2"), "no numbers"),
        (GRID.replace("0.5,0,2", "0.5,0,inf"), "infinite"),
        ("x_mm,y_mm,height_nm\n0,0,1\n0,1,2\n", "all points have the same x"),
        (
            "x_mm,y_mm,height_nm\n0,0,1\n1,1,2\n2,2,3\n8000,8000,4\n",
            "its 4 points fill next to nothing of a grid of 8001 x 8001",
        ),
        ("x_mm,y_mm,height_nm\n0,0,1\n1e-9,1e-9,1\n1e9,1e9,2\n1e9,0,2\n", "two values for one point"),
    ],
)
def test_a_table_that_cannot_be_trusted_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = _write(tmp_path / "m.csv", text)
    with pytest.raises(InputError) as refusal:
        read_map(path)
    assert message in str(refusal.value)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_binary_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="not a text file"):
        read_map(path)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_any_order_and_any_pitch_gives_the_same_map(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    ny, nx = data.draw(st.integers(2, 6)), data.draw(st.integers(2, 6))
    pitch = data.draw(st.floats(1e-3, 10.0))
    start = data.draw(st.floats(-100.0, 100.0))
    height = np.arange(float(ny * nx)).reshape(ny, nx)
    order = data.draw(st.permutations(range(ny * nx)))
    rows = [f"{start + pitch * (k % nx)!r},{start + pitch * (k // nx)!r},{height.flat[k]}" for k in order]
    path = _write(tmp_path_factory.mktemp("xyz") / "m.csv", "\n".join(["x_mm,y_mm,height_nm", *rows]))
    surface = read_map(path)
    np.testing.assert_array_equal(surface.height_nm, height)
    assert surface.pixel_mm == pytest.approx(pitch, rel=1e-6)
    assert surface.x0_mm == pytest.approx(start, rel=1e-9, abs=1e-12)
