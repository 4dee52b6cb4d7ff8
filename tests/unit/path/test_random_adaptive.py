"""The random adaptive path: never crosses itself, covers its region, follows the pitch, and is its seed's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ibfctl.errors import InputError
from ibfctl.path.figures import path_figures
from ibfctl.path.random_adaptive import LATTICE_PER_DISTANCE, POINTS_DISTANCE, random_adaptive
from ibfctl.path.scatter import Field, scatter
from ibfctl.path.tool_path import ToolPath
from tests.support.crossings import crossings

SHAPES = {
    "rectangle": lambda x, y: (np.abs(x) < 9) & (np.abs(y) < 5),
    "disc": lambda x, y: np.hypot(x, y) < 7,
    "ring": lambda x, y: (np.hypot(x, y) < 8) & (np.hypot(x, y) > 3),
    "U": lambda x, y: (np.abs(x) < 8) & (np.abs(y) < 6) & ~((np.abs(x) < 3) & (y > -2)),
}


def fields(shape: str, pitch_mm, smallest_mm: float, largest_mm: float) -> tuple[Field, Field]:
    """Pitch around a shape and the shape itself, on a lattice of 24 x 18 mm."""
    margin_mm = 1.5 * POINTS_DISTANCE * largest_mm
    lattice_mm = POINTS_DISTANCE * smallest_mm / LATTICE_PER_DISTANCE
    axis_x, axis_y = (np.arange(-half - margin_mm, half + margin_mm, lattice_mm) for half in (9.0, 8.0))
    x, y = np.meshgrid(axis_x, axis_y)
    inside = SHAPES[shape](x, y)
    place = axis_x[0], axis_y[0]
    return (
        Field(np.broadcast_to(pitch_mm(x, y), x.shape) * 1.0, lattice_mm, *place),
        Field(np.where(inside, 1.0, np.nan), lattice_mm, *place),
    )


def even(pitch_mm: float, shape: str = "rectangle", seed: int = 0) -> ToolPath:
    return random_adaptive(*fields(shape, lambda x, y: pitch_mm, pitch_mm, pitch_mm), seed)


def pixels(shape: str, inset_mm: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.arange(-9, 9, 0.1), np.arange(-8, 8, 0.1))
    inside = SHAPES[shape](x, y)
    if inset_mm:
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            inside &= SHAPES[shape](x + dx * inset_mm, y + dy * inset_mm)
    return x[inside], y[inside]


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.sampled_from(sorted(SHAPES)),
    wave_per_mm=st.floats(0.0, 2.0),
    contrast=st.floats(1.0, 3.0),
)
def test_it_never_crosses_itself(seed: int, shape: str, wave_per_mm: float, contrast: float) -> None:
    def pitch_mm(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.asarray(0.8 * contrast ** (0.5 * np.sin(wave_per_mm * (x + 0.7 * y))))

    path = random_adaptive(*fields(shape, pitch_mm, 0.8 / np.sqrt(contrast), 0.8 * np.sqrt(contrast)), seed)
    assert path.x_mm.size > 100
    assert crossings(path) == 0
    assert path.length_mm.min() > 0


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_it_covers_the_region_and_little_else(shape: str, seed: int) -> None:
    pitch_mm = 0.6
    path = even(pitch_mm, shape, seed)
    gap_mm = path_figures(path, pixels(shape, inset_mm=pitch_mm)).largest_gap_mm
    assert gap_mm is not None
    assert gap_mm < 1.5 * pitch_mm
    area_mm2 = pixels(shape)[0].size * 0.01
    # As many nodes as a maze would have.
    assert path.x_mm.size * pitch_mm**2 == pytest.approx(area_mm2, rel=0.08)
    x, y = pixels(shape)
    outside_mm = [np.hypot(x - node_x, y - node_y).min() for node_x, node_y in zip(path.x_mm, path.y_mm, strict=True)]
    assert max(outside_mm) < 1.5 * pitch_mm
    assert path.length_mm.max() < 2.2 * pitch_mm
    assert np.median(path.length_mm) == pytest.approx(pitch_mm, rel=0.1)


def test_its_density_follows_the_pitch() -> None:
    path = random_adaptive(*fields("rectangle", lambda x, y: np.where(x < 0, 0.4, 0.8), 0.4, 0.8), 5)
    dense, thin = ((path.x_mm * side > 0.8).sum() for side in (-1, 1))
    assert dense / thin == pytest.approx(4.0, rel=0.1)
    along = path.dwell_x_mm
    assert np.median(path.length_mm[along < -0.8]) == pytest.approx(0.4, rel=0.1)
    assert np.median(path.length_mm[along > 0.8]) == pytest.approx(0.8, rel=0.1)


def test_its_turns_have_every_angle_and_no_direction_is_preferred() -> None:
    path = even(0.4, "disc", 3)
    direction = np.arctan2(np.diff(path.y_mm), np.diff(path.x_mm))
    turn_deg = np.degrees(np.abs((np.diff(direction) + np.pi) % (2 * np.pi) - np.pi))
    shares = np.histogram(turn_deg, bins=[0, 20, 40, 60, 80, 180])[0] / turn_deg.size
    assert shares.min() > 0.08
    spread = np.histogram(direction, bins=8, range=(-np.pi, np.pi))[0] / direction.size
    assert np.abs(spread - 1 / 8).max() < 0.03


def test_a_seed_is_a_path() -> None:
    one, same, other = even(0.8, seed=5), even(0.8, seed=5), even(0.8, seed=6)
    assert np.array_equal(one.x_mm, same.x_mm)
    assert np.array_equal(one.y_mm, same.y_mm)
    assert one.x_mm.size != other.x_mm.size or not np.array_equal(one.x_mm, other.x_mm)


def test_a_region_of_two_parts_is_refused() -> None:
    pitch, needed = fields("rectangle", lambda x, y: 0.5, 0.5, 0.5)
    halves = np.abs(needed.x0_mm + needed.lattice_mm * np.arange(needed.values.shape[1])) > 2.0
    apart = Field(np.where(halves, needed.values, np.nan), needed.lattice_mm, needed.x0_mm, needed.y0_mm)
    with pytest.raises(InputError, match="separate parts"):
        random_adaptive(pitch, apart, 0)
    nowhere = Field(np.full_like(needed.values, np.nan), needed.lattice_mm, needed.x0_mm, needed.y0_mm)
    with pytest.raises(InputError, match="empty"):
        random_adaptive(pitch, nowhere, 0)


@pytest.mark.parametrize("seed", [0, 1])
def test_scattered_points_keep_their_distance_and_leave_no_hole(seed: int) -> None:
    lattice_mm = 0.1
    x, y = np.meshgrid(np.arange(0, 12, lattice_mm), np.arange(0, 8, lattice_mm))
    distance_mm = 0.5 + 0.05 * x
    region = np.hypot((x - 6) / 6, (y - 4) / 4) < 1
    points = scatter(Field(np.where(region, distance_mm, np.nan), lattice_mm, 0.0, 0.0), np.random.default_rng(seed))
    apart = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    own_mm = 0.5 + 0.05 * points[:, 0]
    # Jitter brings two points closer by at most two diagonals of half a lattice place.
    assert (apart.min(axis=1) > 0.85 * own_mm - 1.5 * lattice_mm).all()
    places = np.column_stack([x[region], y[region]])
    far_mm = np.hypot(*(places[:, None] - points[None]).transpose(2, 0, 1)) - own_mm
    assert far_mm.min(axis=1).max() < 1.5 * lattice_mm
