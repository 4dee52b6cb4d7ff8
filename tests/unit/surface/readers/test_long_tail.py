"""The optional library: how it is asked, and, where it is installed, what it answers."""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ibfctl.errors import InputError
from ibfctl.jobs.plan_files import hashed
from ibfctl.surface.readers import read_influence, read_map
from tests.support.map_files import hill_nm, write_metropro


class Reader:
    """What the library gives for a file: heights (nx, ny), rows from the top, masked where there is no data."""

    def __init__(self, **channel: Any) -> None:
        self.default_channel = SimpleNamespace(
            **{"dim": 2, "nb_grid_pts": (7, 5), "unit": "µm", "physical_sizes": (3500.0, 2500.0), **channel}
        )

    def topography(self, **given: Any) -> SimpleNamespace:
        assert bool(given) == (self.default_channel.physical_sizes is None)
        return SimpleNamespace(heights=lambda: np.ma.masked_invalid(hill_nm()[::-1].T / 1e3))


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Put a stand-in for the library in its place; return how to say what it finds, and the map's name."""
    library = ModuleType("SurfaceTopography.IO")
    monkeypatch.setitem(sys.modules, "SurfaceTopography", ModuleType("SurfaceTopography"))
    monkeypatch.setitem(sys.modules, "SurfaceTopography.IO", library)
    path = tmp_path / "m.opd"
    path.write_bytes(b"of some instrument")

    def finds(reader: Any) -> str:
        def open_topography(name: str) -> Any:
            assert name == str(path)
            if isinstance(reader, Exception):
                raise reader
            return reader

        library.open_topography = open_topography  # type: ignore[attr-defined]
        return f"surfacetopography:{path}"

    return finds


def test_unit_pixel_size_and_holes_are_those_of_the_library(stand_in: Any) -> None:
    surface = read_map(stand_in(Reader()))
    np.testing.assert_allclose(surface.height_nm, hill_nm())
    assert surface.pixel_mm == pytest.approx(0.5)


def test_what_the_library_does_not_know_must_be_given(stand_in: Any) -> None:
    spec = stand_in(Reader(physical_sizes=None))
    with pytest.raises(InputError, match="--map-pixel-mm"):
        read_map(spec)
    assert read_map(spec, pixel_mm=0.25).pixel_mm == 0.25
    with pytest.raises(InputError, match="--map-unit"):
        read_map(stand_in(Reader(unit=None)))


@pytest.mark.parametrize(
    ("found", "message"),
    [
        (Reader(dim=1), "holds a line"),
        (Reader(nb_grid_pts=(10**6, 10**6)), "declares 1000000 x 1000000 pixels"),
        (Reader(unit="parsec"), "unknown unit 'parsec'"),
        (Reader(physical_sizes=(7.0, 10.0)), "not square"),
        (RuntimeError("no reader\nfor this"), r"cannot read it \(no reader for this\)"),
    ],
)
def test_what_cannot_be_trusted_is_refused(stand_in: Any, found: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_map(stand_in(found))


def test_heights_are_no_rates_and_the_file_itself_is_hashed(stand_in: Any, tmp_path: Path) -> None:
    spec = stand_in(Reader())
    with pytest.raises(InputError, match="ibfctl tif"):
        read_influence(spec)
    assert hashed(spec) == hashed(tmp_path / "m.opd")


def test_without_the_extra_one_line_says_which(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    path = write_metropro(tmp_path / "m.dat", hill_nm())
    with pytest.raises(InputError, match=r"ibfctl\[long-tail\]"):
        read_map(f"surfacetopography:{path}")
    with pytest.raises(InputError, match="cannot be read"):
        read_map(f"surfacetopography:{tmp_path / 'absent.opd'}")


def test_the_library_itself_sees_what_we_see(tmp_path: Path) -> None:
    pytest.importorskip("SurfaceTopography")
    path = write_metropro(tmp_path / "m.dat", hill_nm(), 0.25)
    ours, other = read_map(path), read_map(f"surfacetopography:{path}")
    np.testing.assert_allclose(other.height_nm, ours.height_nm, rtol=1e-6)
    assert other.pixel_mm == pytest.approx(ours.pixel_mm, rel=1e-6)
