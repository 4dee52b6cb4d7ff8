"""The clear aperture and the sizes of map and tool, checked before anything is computed."""

from __future__ import annotations

import re

import numpy as np
import pytest

from ibfctl.errors import InputError
from ibfctl.planning.aperture import bounding_box, check_sizes, clear_aperture_mask, grown
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import Rectangle, SurfaceMap


@pytest.fixture
def surface() -> SurfaceMap:
    height_nm = np.zeros((8, 12))
    height_nm[2, 3] = np.nan
    height_nm[:, 11] = np.nan
    return SurfaceMap(height_nm, 0.5, 1.0, -2.0)  # pixel centres x 1.0 to 6.5, y -2.0 to 1.5


def test_without_a_rectangle_every_valid_pixel_counts(surface: SurfaceMap) -> None:
    assert np.array_equal(clear_aperture_mask(surface, None), np.isfinite(surface.height_nm))


def test_pixels_on_the_edge_of_the_rectangle_count_and_holes_do_not(surface: SurfaceMap) -> None:
    mask = clear_aperture_mask(surface, Rectangle(2.0, 3.5, -1.5, 0.0))
    expected = np.zeros((8, 12), dtype=bool)
    expected[1:5, 2:6] = True
    expected[2, 3] = False
    assert np.array_equal(mask, expected)
    assert bounding_box(surface, mask) == Rectangle(1.75, 3.75, -1.75, 0.25)


def test_the_overrun_is_the_same_on_all_sides() -> None:
    assert grown(Rectangle(0.0, 1.0, 2.0, 4.0), 0.5) == Rectangle(-0.5, 1.5, 1.5, 4.5)


@pytest.mark.parametrize(
    ("rectangle", "said"),
    [
        (Rectangle(3.0, 2.0, -1.0, 1.0), "is empty"),
        (Rectangle(2.0, 2.0, -1.0, 1.0), "is empty"),
        (Rectangle(2.0, 3.0, 1.0, -1.0), "is empty"),
        (Rectangle(float("nan"), 3.0, -1.0, 1.0), "is empty"),
        (Rectangle(2.0, float("inf"), -1.0, 1.0), "is empty"),
        (Rectangle(50.0, 60.0, -1.0, 1.0), "holds no valid pixel"),
        (Rectangle(2.1, 2.2, -1.0, 1.0), "holds no valid pixel"),
        (Rectangle(6.4, 7.0, -9.0, 9.0), "holds no valid pixel"),
        (Rectangle(2.4, 2.6, -1.1, -0.9), "holds no valid pixel"),
    ],
    ids=["inside out", "no width", "y inside out", "nan", "infinite", "beside", "between pixels", "column", "hole"],
)
def test_an_aperture_without_pixels_is_refused(surface: SurfaceMap, rectangle: Rectangle, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        clear_aperture_mask(surface, rectangle)
    assert "--clear-aperture" in caught.value.hint
    assert "\n" not in str(caught.value)


def test_an_aperture_beside_the_map_says_where_the_map_is(surface: SurfaceMap) -> None:
    with pytest.raises(InputError, match=re.escape("x 0.75 to 6.75, y -2.25 to 1.75 mm")):
        clear_aperture_mask(surface, Rectangle(50.0, 60.0, -1.0, 1.0))


def test_a_tool_larger_than_the_map_or_narrower_than_its_pixels_is_refused(surface: SurfaceMap) -> None:
    check_sizes(surface, gaussian(1.0, 1.0, 3.0, 0.1))
    with pytest.raises(InputError, match=r"6\.2 mm wide, larger than the map \(6 mm\)"):
        check_sizes(surface, gaussian(1.0, 1.0, 3.1, 0.1))
    with pytest.raises(InputError, match="less than two pixels"):
        check_sizes(surface, gaussian(0.2, 1.0, 0.4, 0.1))


@pytest.mark.parametrize(
    ("height_nm", "pixel_mm", "said"),
    [
        (np.zeros(9), 0.5, "table of at least 2 x 2"),
        (np.zeros((1, 9)), 0.5, "table of at least 2 x 2"),
        (np.zeros((3, 3)), 0.0, "pixel size is 0 mm"),
        (np.zeros((3, 3)), -0.5, "pixel size"),
        (np.zeros((3, 3)), float("nan"), "pixel size"),
        (np.full((3, 3), np.nan), 0.5, "no valid pixel"),
        (np.full((3, 3), np.inf), 0.5, "infinite heights"),
    ],
)
def test_a_map_of_nonsense_is_refused(height_nm: np.ndarray, pixel_mm: float, said: str) -> None:
    with pytest.raises(InputError, match=said):
        SurfaceMap(height_nm, pixel_mm, 0.0, 0.0)


def test_a_map_is_centred_on_the_part_unless_it_says_where_it_is() -> None:
    centred = SurfaceMap.centred(np.zeros((4, 7)), 0.5)
    assert centred.x_mm.tolist() == [-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5]
    assert centred.y_mm.tolist() == [-0.75, -0.25, 0.25, 0.75]
    assert centred.extent_mm == Rectangle(-1.75, 1.75, -1.0, 1.0)
