"""Damaged, cut and hostile files of every format: one clear line, and never more memory than the map needs."""

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy import io

from ibfctl.errors import InputError
from ibfctl.surface.readers import MAP_SUFFIXES, hdf5_apart, read_map
from tests.support.map_files import hill_nm, write_datx, write_fits, write_mat73, write_metropro, write_tiff

Writer = Callable[[Path, np.ndarray], object]
GIVEN: dict[str, dict[str, object]] = {
    ".tif": {"height_unit": "nm", "pixel_mm": 0.5},
    ".fits": {"pixel_mm": 0.5},
}


def _text(path: Path, height_nm: np.ndarray) -> None:
    rows = [f"{0.5 * x:.3f},{0.5 * y:.3f},{value:.6f}" for (y, x), value in np.ndenumerate(height_nm)]
    path.write_text("\n".join(["x_mm,y_mm,height_nm", *rows]))


def _mat(path: Path, height_nm: np.ndarray) -> None:
    y, x = np.mgrid[: height_nm.shape[0], : height_nm.shape[1]] * 5e-4
    io.savemat(path, {"X": x, "Y": y, "Z": height_nm * 1e-9}, do_compression=True)


def _h5(path: Path, height_nm: np.ndarray) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("height_nm", data=height_nm, compression="gzip", shuffle=True)
        file.attrs["pixel_mm"] = 0.5


WRITERS: dict[str, Writer] = {
    ".npz": lambda path, height_nm: np.savez(path, height_nm=height_nm, pixel_mm=0.5),
    ".mat": _mat,
    ".csv": _text,
    ".dat": write_metropro,
    ".fits": lambda path, height_nm: write_fits(path, height_nm, -32, BUNIT="nm"),
    ".tif": lambda path, height_nm: write_tiff(path, height_nm.astype("f4"), rows_per_strip=2),
}
APART: dict[str, Writer] = {
    ".h5": _h5,
    ".datx": write_datx,
    "73.mat": lambda path, height_nm: write_mat73(path, Z=height_nm * 1e-9, pixel_m=np.array(5e-4)),
}
SAME_READER = {".xyz", ".txt", ".fit", ".tiff", ".hdf5"}
FIXED_BYTES = 2 << 20


@st.composite
def damages(draw: st.DrawFn) -> Callable[[bytes], bytes]:
    """Change a few bytes, mostly near the beginning, or cut the file, or both."""
    place = st.one_of(st.floats(0, 0.05), st.floats(0, 1))
    extreme = st.sampled_from([b"\0", b"\xff", b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\1", b"9", b"-", b"e"])
    changes = draw(st.lists(st.tuples(place, st.one_of(extreme, st.binary(min_size=1, max_size=8))), max_size=4))
    cut = draw(st.one_of(st.just(1.0), st.floats(0, 1)))

    def damage(whole: bytes) -> bytes:
        content = bytearray(whole)
        for share, piece in changes:
            at = int(share * (len(content) - 1))
            content[at : at + len(piece)] = piece
        return bytes(content[: int(cut * len(content))])

    return damage


def test_every_suffix_is_covered() -> None:
    assert {*WRITERS, *APART, *SAME_READER} - {"73.mat"} == set(MAP_SUFFIXES)


@pytest.mark.parametrize("suffix", WRITERS)
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(damage=damages())
def test_a_damaged_file_is_read_or_refused_in_one_line(
    tmp_path: Path, suffix: str, damage: Callable[[bytes], bytes]
) -> None:
    _read_damaged(tmp_path / f"m{suffix}", WRITERS[suffix], damage)


@pytest.mark.parametrize("suffix", APART)
@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(damage=damages())
def test_a_damaged_hdf5_file_is_read_or_refused_in_one_line(
    tmp_path: Path, suffix: str, damage: Callable[[bytes], bytes]
) -> None:
    _read_damaged(tmp_path / f"m{suffix}", APART[suffix], damage)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", APART)
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(damage=damages())
def test_many_damaged_hdf5_files(tmp_path: Path, suffix: str, damage: Callable[[bytes], bytes]) -> None:
    _read_damaged(tmp_path / f"m{suffix}", APART[suffix], damage)


def test_a_process_that_dies_is_a_refusal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hdf5_apart, "_CHILD", "ibfctl.absent")
    _h5(tmp_path / "m.h5", hill_nm())
    with pytest.raises(InputError, match="the HDF5 library cannot read it"):
        read_map(tmp_path / "m.h5")


def _read_damaged(path: Path, write: Writer, damage: Callable[[bytes], bytes]) -> None:
    write(path, hill_nm())
    path.write_bytes(damage(path.read_bytes()))
    given = GIVEN.get(path.suffix, {})
    said = str(path)
    tracemalloc.start()
    try:
        read_map(path, **given)
    except InputError as refusal:
        said = str(refusal)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert str(path) in said
    assert len(said.splitlines()) == 1
    assert peak < FIXED_BYTES


@pytest.mark.parametrize("suffix", [*WRITERS, *APART])
def test_reading_needs_at_most_four_times_the_maps_memory(tmp_path: Path, suffix: str) -> None:
    height_nm = np.random.default_rng(1).normal(size=(512, 640))
    path = tmp_path / f"m{suffix}"
    {**WRITERS, **APART}[suffix](path, height_nm)
    read_map(path, **GIVEN.get(suffix, {}))  # what is imported on the way does not count
    tables = 3 if suffix == ".mat" else 1  # X, Y and Z
    declared = max(tables * height_nm.nbytes, path.stat().st_size)
    tracemalloc.start()
    try:
        read_map(path, **GIVEN.get(suffix, {}))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak <= 4 * declared
