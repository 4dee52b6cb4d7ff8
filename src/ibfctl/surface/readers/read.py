"""Choose the reader by the file's suffix, and check what came out."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ibfctl.errors import InputError
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import SurfaceMap
from ibfctl.surface.readers.formula import GAUSSIAN_PREFIX, read_gaussian
from ibfctl.surface.readers.long_tail import LONG_TAIL_PREFIX
from ibfctl.surface.readers.quantity import HEIGHT, RATE, Quantity
from ibfctl.surface.readers.table import Table

# Module and function: imported when they are needed, because scipy.io alone takes a quarter of a second to load.
_READERS = {
    ".npz": ("npz", "read_npz"),
    ".mat": ("mat", "read_mat"),
    ".csv": ("xyz", "read_xyz"),
    ".xyz": ("xyz", "read_xyz"),
    ".txt": ("xyz", "read_xyz"),
    ".dat": ("metropro", "read_metropro"),
    ".fits": ("fits", "read_fits"),
    ".fit": ("fits", "read_fits"),
    ".tif": ("tiff", "read_tiff"),
    ".tiff": ("tiff", "read_tiff"),
    ".h5": ("hdf5_apart", "read_apart"),
    ".hdf5": ("hdf5_apart", "read_apart"),
    ".datx": ("hdf5_apart", "read_apart"),
}
_LONG_TAIL = ("long_tail", "read_long_tail")
_WITH_ARRAYS = (".mat", ".h5", ".hdf5", ".datx")
MAP_SUFFIXES = tuple(_READERS)


def read_map(
    spec: str | Path,
    *,
    pixel_mm: float | None = None,
    height_unit: str | None = None,
    array: str | None = None,
) -> SurfaceMap:
    """Read a surface map.

    Parameters
    ----------
    spec
        A file of a kind in docs/file-formats.md, told by its suffix, or `surfacetopography:` and any file.
    pixel_mm, height_unit
        What the file does not say; given although the file says it, they must agree.
    array
        Array to read of a file that holds several.

    Raises
    ------
    InputError
        If the file cannot be read, lacks a unit, mixes units, or holds no map.
    """
    path, table = _read(str(spec), HEIGHT, pixel_mm, height_unit, array)
    if table.x0_mm is None or table.y0_mm is None:
        with _named(path):
            return SurfaceMap.centred(table.values, table.pixel_mm)
    with _named(path):
        return SurfaceMap(table.values, table.pixel_mm, table.x0_mm, table.y0_mm)


def read_influence(
    spec: str | Path, *, pixel_mm: float | None = None, rate_unit: str | None = None, array: str | None = None
) -> InfluenceFunction:
    """Read a tool influence function from a file, or make one from `gaussian:...`.

    Parameters
    ----------
    spec
        A file, or `gaussian:fwhm_mm=..,peak_nm_s=..,radius_mm=..`.
    pixel_mm, rate_unit
        What the file does not say; given although the file says it, they must agree. For a formula
        `pixel_mm` is the pitch on which it is sampled.
    array
        Array to read of a file that holds several.

    Raises
    ------
    InputError
        If the file cannot be read, lacks a unit, mixes units, or holds no influence function.
    """
    if str(spec).startswith(GAUSSIAN_PREFIX):
        return read_gaussian(str(spec), pixel_mm)
    path, table = _read(str(spec), RATE, pixel_mm, rate_unit, array)
    if table.x0_mm is not None and table.y0_mm is not None:
        ny, nx = table.values.shape
        off_x = table.x0_mm / table.pixel_mm + 0.5 * (nx - 1)
        off_y = table.y0_mm / table.pixel_mm + 0.5 * (ny - 1)
        if max(abs(off_x), abs(off_y)) > 0.5:
            raise InputError(
                f"influence function {path}: its centre is at x {off_x * table.pixel_mm:.4g} mm, "
                f"y {off_y * table.pixel_mm:.4g} mm, not at the origin",
                "shift or crop the table so that the tool's centre is at 0, 0 in its middle",
            )
    with _named(path):
        return InfluenceFunction(table.values, table.pixel_mm)


def _read(
    spec: str, quantity: Quantity, pixel_mm: float | None, unit: str | None, array: str | None
) -> tuple[Path, Table]:
    path = Path(spec.removeprefix(LONG_TAIL_PREFIX))
    reader = _LONG_TAIL if spec.startswith(LONG_TAIL_PREFIX) else _READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{quantity.what} {path}: unknown kind of file {path.suffix or 'without suffix'!r}",
            f"give one of {', '.join(MAP_SUFFIXES)}, or {LONG_TAIL_PREFIX}FILE",
        )
    if array is not None and path.suffix.lower() not in _WITH_ARRAYS:
        raise InputError(
            f"{quantity.what} {path}: only {', '.join(_WITH_ARRAYS)} files hold arrays to choose from",
            "leave the option out",
        )
    try:
        with path.open("rb"):
            pass
    except OSError as error:
        raise InputError(f"{quantity.what} {path}: cannot be read ({error.strerror})", "check the path") from error
    module, function = reader
    read = getattr(importlib.import_module(f"ibfctl.surface.readers.{module}"), function)
    chosen = {"array": array} if array is not None else {}
    with np.errstate(all="ignore"):  # what overflows is infinite, and refused as such
        table: Table = read(path, quantity, pixel_mm, unit, **chosen)
        _refuse_implausible(table, quantity, path)
    return path, table


def _refuse_implausible(table: Table, quantity: Quantity, path: Path) -> None:
    valid = table.values[np.isfinite(table.values)]
    span = float(np.ptp(valid)) if valid.size else 0.0
    if span > quantity.largest:
        raise InputError(
            f"{quantity.what} {path}: spans {span:.3g} {quantity.example.removeprefix(quantity.stem + '_')}, "
            "which no finishing job does",
            f"the units are probably mixed up: check the file and {quantity.unit_option}",
        )


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Name the file in what the map or the influence function itself refuses."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error.message}", error.hint) from error
