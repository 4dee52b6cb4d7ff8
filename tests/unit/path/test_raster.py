"""The serpentine raster covers what it should, in lines of one pitch and steps of one step."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.errors import InputError
from ibfctl.path.raster import raster
from ibfctl.surface.map import Rectangle

AREA = Rectangle(-4.1, 6.3, 1.0, 5.2)


@pytest.mark.parametrize("scan_axis", ["x", "y"])
@pytest.mark.parametrize(("pitch_mm", "step_mm"), [(0.5, 0.5), (0.3, 1.7), (50.0, 0.1), (0.7, 50.0)])
def test_lines_of_one_pitch_walked_to_and_fro_over_the_whole_area(
    scan_axis: str, pitch_mm: float, step_mm: float
) -> None:
    path = raster(AREA, pitch_mm, step_mm, scan_axis)  # type: ignore[arg-type]
    along, across = (path.x_mm, path.y_mm) if scan_axis == "x" else (path.y_mm, path.x_mm)
    low, high = (AREA.x0_mm, AREA.x1_mm) if scan_axis == "x" else (AREA.y0_mm, AREA.y1_mm)
    lines = np.unique(across)
    per_line = along.size // lines.size
    assert along.size == per_line * lines.size
    np.testing.assert_allclose(np.diff(lines), pitch_mm, rtol=1e-9)
    along, across = along.reshape(-1, per_line), across.reshape(-1, per_line)
    assert (across == across[:, :1]).all()
    assert (np.diff(across[:, 0]) > 0).all()
    direction = np.where(np.arange(lines.size) % 2, -1, 1)[:, None]
    np.testing.assert_allclose(np.diff(along, axis=1) * direction, step_mm, rtol=1e-9)
    # From line to line it goes straight across.
    assert (along[1:, 0] == along[:-1, -1]).all()
    # The area is reached on both sides, by less than a spacing more.
    for reached, (edge0, edge1), spacing in (
        (along, (low, high), step_mm),
        (across, (AREA.y0_mm, AREA.y1_mm) if scan_axis == "x" else (AREA.x0_mm, AREA.x1_mm), pitch_mm),
    ):
        assert edge0 - spacing < reached.min() <= edge0 + 1e-9
        assert edge1 - 1e-9 <= reached.max() < edge1 + spacing
        assert reached.min() + reached.max() == pytest.approx(edge0 + edge1)


def test_a_pitch_that_divides_the_area_ends_on_its_edges() -> None:
    path = raster(Rectangle(0.0, 3.0, -1.0, 1.0), 0.1, 0.1)
    assert np.unique(path.y_mm).size == 21
    assert (path.x_mm.min(), path.x_mm.max()) == pytest.approx((0.0, 3.0))


@pytest.mark.parametrize("value", [0.0, -0.5, float("nan"), float("inf")])
def test_a_spacing_that_is_none_is_refused_by_its_option(value: float) -> None:
    with pytest.raises(InputError, match="pitch") as caught:
        raster(AREA, value, 0.5)
    assert "--pitch-mm" in caught.value.hint
    with pytest.raises(InputError, match="step") as caught:
        raster(AREA, 0.5, value)
    assert "--step-mm" in caught.value.hint


@pytest.mark.parametrize(("pitch_mm", "step_mm"), [(1e-9, 0.5), (0.5, 1e-9), (1e-3, 1e-3)])
def test_a_spacing_that_would_fill_the_memory_is_refused(pitch_mm: float, step_mm: float) -> None:
    with pytest.raises(InputError, match="more than"):
        raster(AREA, pitch_mm, step_mm)
