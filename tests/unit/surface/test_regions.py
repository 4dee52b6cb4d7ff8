"""Regions on the pixels of a map: what lies in them, on their edge, and what is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.errors import InputError
from ibfctl.surface.map import Rectangle, SurfaceMap
from ibfctl.surface.regions import Circle, MaskFile, Polygon, pixels_in

SURFACE = SurfaceMap(np.zeros((21, 31)), 0.5, -7.0, -5.0)  # x -7 to 8, y -5 to 5
X, Y = np.meshgrid(SURFACE.x_mm, SURFACE.y_mm)


def test_a_rectangle_holds_the_pixels_on_its_edge() -> None:
    found = pixels_in(Rectangle(-2.0, 3.1, -1.5, 1.0), SURFACE)
    assert np.array_equal(found, (X >= -2) & (X <= 3) & (Y >= -1.5) & (Y <= 1))


def test_a_circle_is_round_and_holds_the_pixels_on_its_edge() -> None:
    found = pixels_in(Circle(1.0, -0.5, 2.5), SURFACE)
    assert np.array_equal(found, np.hypot(X - 1, Y + 0.5) <= 2.5 + 1e-12)
    assert found[np.isclose(np.hypot(X - 1, Y + 0.5), 2.5)].all()


@pytest.mark.parametrize("turned", [False, True])
def test_a_polygon_that_is_a_rectangle_is_that_rectangle(turned: bool) -> None:
    corners = ((-2.0, -1.5), (3.0, -1.5), (3.0, 1.0), (-2.0, 1.0))
    found = pixels_in(Polygon(corners[::-1] if turned else corners), SURFACE)
    assert np.array_equal(found, pixels_in(Rectangle(-2.0, 3.0, -1.5, 1.0), SURFACE))


GRID = st.integers(-600, 600).map(lambda value: value / 64)


@settings(deadline=None)
@given(st.lists(st.tuples(GRID, GRID), min_size=3, max_size=9, unique=True))
def test_a_polygon_holds_what_is_wound_around(points: list[tuple[float, float]]) -> None:
    """The even-odd rule, by the sum of the angles under which a pixel sees the edges, where no edge is near."""
    found = pixels_in(Polygon(tuple(points)), SURFACE)
    start = np.array(points) @ np.array([1, 1j])
    seen = start[:, None, None] - (X + 1j * Y)
    clear = np.abs(seen).min(axis=0) > 1e-6
    with np.errstate(invalid="ignore", divide="ignore"):
        angle = np.angle(np.roll(seen, -1, axis=0) / seen)
    clear &= (np.abs(angle) < np.pi - 1e-6).all(axis=0)
    turns = np.rint(np.where(clear, angle.sum(axis=0), 0.0) / (2 * np.pi)).astype(int)
    assert np.array_equal(found[clear], turns[clear] % 2 == 1)


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
@pytest.mark.parametrize("kind", [bool, np.uint8, np.float64])
def test_a_mask_is_zero_outside(tmp_path: Path, suffix: str, kind: type) -> None:
    mask = np.random.default_rng(2).random(X.shape) < 0.4
    path = tmp_path / f"mask{suffix}"
    if suffix == ".npy":
        np.save(path, mask.astype(kind))
    else:
        np.savez(path, mask=mask.astype(kind))
    assert np.array_equal(pixels_in(MaskFile(path), SURFACE), mask)


@pytest.mark.parametrize(
    ("region", "said"),
    [
        (Circle(0, 0, 0), "is empty"),
        (Circle(0, float("nan"), 1), "is empty"),
        (Circle(0, 0, float("inf")), "is empty"),
        (Polygon(((0, 0), (1, 1))), "polygon of 2 points"),
        (Polygon(((0, 0), (1, 1), (2, float("nan")))), "polygon"),
        (Polygon(()), "polygon of 0 points"),
        (MaskFile(Path("absent.npy")), "absent.npy"),
    ],
)
def test_what_is_no_region_is_refused(region: Circle | Polygon | MaskFile, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        pixels_in(region, SURFACE)
    assert "\n" not in str(caught.value)


def test_a_mask_that_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mask.npz"
    for arrays, said in (
        ({"mask": np.ones((3, 4))}, r"shape \(3, 4\), the map of shape \(21, 31\)"),
        ({"mask": np.full(X.shape, "inside")}, "no numbers"),
        ({"other": np.ones(X.shape)}, "cannot be read"),
    ):
        np.savez(path, **arrays)
        with pytest.raises(InputError, match=said):
            pixels_in(MaskFile(path), SURFACE)
    np.savez(path, mask=np.ones(X.shape))
    whole = path.read_bytes()
    for size in (0, 50, len(whole) // 2):
        path.write_bytes(whole[:size])
        with pytest.raises(InputError, match="cannot be read"):
            pixels_in(MaskFile(path), SURFACE)
