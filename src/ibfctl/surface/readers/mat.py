"""MATLAB files with X, Y, Z in metres (rates in metres per second), as the field exchanges them.

Of a surface the array `Z_to_remove` is read where the file has it (what is to go away), else `Z`; `array`
chooses otherwise. The pixel size comes from X and Y, or from `pixel_m` or `m_per_pixel`; where several say it
they must agree. Version 5 is read here; version 7.3 is HDF5.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.surface.readers.hdf5_apart import read_apart
from ibfctl.surface.readers.mat5 import matrices, read_matrix
from ibfctl.surface.readers.quantity import MAX_PITCH_MISMATCH, Quantity
from ibfctl.surface.readers.table import Table, check_size, square_pitch, uniform_axis
from ibfctl.units import MM_PER_M

FloatArray = NDArray[np.float64]

_PREFERRED = ("Z_to_remove", "Z")
_PIXEL_NAMES = ("pixel_m", "m_per_pixel")
_VERSION_73 = b"MATLAB 7.3 MAT-file"


def read_mat(
    path: Path, quantity: Quantity, pixel_mm: float | None, unit: str | None, array: str | None = None
) -> Table:
    """Read one array of a MATLAB file."""
    where = f"{quantity.what} {path}"
    with path.open("rb") as stream:
        if stream.read(len(_VERSION_73)) == _VERSION_73:
            return read_apart(path, quantity, pixel_mm, unit, array)
    held = matrices(path, where)

    def fetch(name: str) -> FloatArray:
        check_size(held[name].shape, f"{where}: {name}")
        return read_matrix(path, held[name], f"{where}: {name}")

    return arranged(list(held), fetch, quantity, pixel_mm, unit, array, where)


def arranged(
    names: list[str],
    fetch: Callable[[str], FloatArray],
    quantity: Quantity,
    pixel_mm: float | None,
    unit: str | None,
    array: str | None,
    where: str,
) -> Table:
    """Make the table of a file that holds variables of these names, each (ny, nx) as MATLAB shows it."""
    scale = quantity.scale(None, unit or ("m" if quantity.stem == "height" else "m/s"), where)
    name = _array_name(names, array, where)
    arrays = {key: fetch(key) for key in dict.fromkeys([name, "X", "Y", *_PIXEL_NAMES]) if key in names}
    return _table(arrays, arrays[name] * scale, quantity, pixel_mm, where)


def _array_name(names: list[str], array: str | None, where: str) -> str:
    for name in (array,) if array else _PREFERRED:
        if name in names:
            return name
    held = ", ".join(sorted(names)) or "nothing"
    raise InputError(
        f"{where}: has no array {array or ' or '.join(_PREFERRED)}, it holds {held}",
        "name the array to read",
    )


def _table(
    arrays: dict[str, FloatArray], values: FloatArray, quantity: Quantity, pixel_mm: float | None, where: str
) -> Table:
    declared_mm = [float(arrays[key].reshape(-1)[0]) * MM_PER_M for key in _PIXEL_NAMES if key in arrays]
    if "X" not in arrays or "Y" not in arrays:
        declared = _agreed(declared_mm, where)
        return Table(values, quantity.pixel_mm(declared, pixel_mm, where))
    x, y = arrays["X"], arrays["Y"]
    if x.shape != y.shape or x.shape != values.shape:
        raise InputError(f"{where}: X, Y and Z are of different shapes", "store one coordinate per pixel")
    if np.ptp(x[0]) == 0:  # written with ndgrid: x varies down the columns
        x, y, values = x.T, y.T, values.T
    if (x != x[:1]).any() or (y != y[:, :1]).any():
        raise InputError(f"{where}: X and Y are no rectangular grid", "interpolate to a uniform grid first")
    columns = uniform_axis(x[0] * MM_PER_M, "X", where)
    rows = uniform_axis(y[:, 0] * MM_PER_M, "Y", where)
    if (columns.size, rows.size) != (x.shape[1], x.shape[0]):
        raise InputError(f"{where}: X or Y repeats coordinates", "store one coordinate per pixel")
    declared = _agreed([square_pitch(columns.pitch, rows.pitch, where), *declared_mm], where)
    ordered = np.empty_like(values)
    ordered[np.ix_(rows.index, columns.index)] = values
    return Table(ordered, quantity.pixel_mm(declared, pixel_mm, where), columns.start, rows.start)


def _agreed(declared_mm: list[float], where: str) -> float | None:
    if not declared_mm:
        return None
    if any(abs(value - declared_mm[0]) > MAX_PITCH_MISMATCH * abs(declared_mm[0]) for value in declared_mm):
        sizes = " and ".join(f"{value:.6g} mm" for value in declared_mm)
        raise InputError(f"{where}: says its pixel size more than once: {sizes}", "X, Y and pixel_m must be in metres")
    return declared_mm[0]
