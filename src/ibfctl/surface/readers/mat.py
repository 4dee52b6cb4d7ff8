"""MATLAB version 5 files with X, Y, Z in metres (rates in metres per second), as the field exchanges them.

Of a surface the array `Z_to_remove` is read where the file has it (what is to go away), else `Z`; `array`
chooses otherwise. The pixel size comes from X and Y, or from `pixel_m` or `m_per_pixel`; where several say it
they must agree.
"""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import io

from ibfctl.errors import InputError
from ibfctl.surface.readers.quantity import MAX_PITCH_MISMATCH, MAX_PIXELS, Quantity
from ibfctl.surface.readers.table import Table, check_size, square_pitch, uniform_axis
from ibfctl.units import MM_PER_M

FloatArray = NDArray[np.float64]

_PREFERRED = ("Z_to_remove", "Z")
_PIXEL_NAMES = ("pixel_m", "m_per_pixel")
_MAX_BYTES = 8 * MAX_PIXELS
_HEADER_BYTES, _TAG_BYTES, _COMPRESSED = 128, 8, 15


def read_mat(
    path: Path, quantity: Quantity, pixel_mm: float | None, unit: str | None, array: str | None = None
) -> Table:
    """Read one array of a MATLAB file."""
    where = f"{quantity.what} {path}"
    try:
        _refuse_bombs(path, where)
        shapes = {name: shape for name, shape, _ in io.whosmat(path)}
        name = _array_name(shapes, array, where)
        wanted = [name, *(key for key in ("X", "Y", *_PIXEL_NAMES) if key in shapes)]
        for key in wanted:
            check_size(shapes[key], f"{where}: {key}")
        content = io.loadmat(path, variable_names=wanted)
        arrays = {key: _real(content[key], f"{where}: {key}") for key in wanted}
    except InputError:
        raise
    except Exception as error:  # a damaged file makes scipy and zlib raise almost anything
        raise InputError(
            f"{where}: is no readable MATLAB version 5 file ({error})",
            "save it in MATLAB with the option -v7",
        ) from error
    scale = quantity.scale(None, unit or ("m" if quantity.stem == "height" else "m/s"), where)
    return _table(arrays, arrays[name] * scale, quantity, pixel_mm, where)


def _array_name(shapes: dict[str, tuple[int, ...]], array: str | None, where: str) -> str:
    for name in (array,) if array else _PREFERRED:
        if name in shapes:
            return name
    held = ", ".join(sorted(shapes)) or "nothing"
    raise InputError(
        f"{where}: has no array {array or ' or '.join(_PREFERRED)}, it holds {held}",
        "name the array to read",
    )


def _real(value: NDArray[np.generic], where: str) -> FloatArray:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
        raise InputError(f"{where}: does not hold real numbers", "store it as a real matrix")
    return value.astype(np.float64)


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


def _refuse_bombs(path: Path, where: str) -> None:
    """Inflate no further than the largest allowed map: a small file may declare gigabytes."""
    with path.open("rb") as stream:
        stream.seek(_HEADER_BYTES)
        while len(tag := stream.read(_TAG_BYTES)) == _TAG_BYTES:
            kind, size = (int(word) for word in np.frombuffer(tag, dtype="<u4"))
            body = stream.read(size)
            if len(body) < size:
                raise InputError(f"{where}: is cut short", "copy the file again")
            if kind != _COMPRESSED:
                continue
            inflater = zlib.decompressobj()
            left = _MAX_BYTES
            while body and left > 0:
                left -= len(inflater.decompress(body, 1 << 20))
                body = inflater.unconsumed_tail
            if body:
                raise InputError(f"{where}: unpacks to more than {_MAX_BYTES >> 20} MiB", "crop or bin the map")
