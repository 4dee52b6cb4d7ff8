"""Text tables: one point per row, a header that names columns and units (`x_mm,y_mm,height_nm`)."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.surface.readers.quantity import MAX_PIXELS, Quantity, length_scale
from ibfctl.surface.readers.table import Table, check_size, square_pitch, uniform_axis

_COMMENT = "#"
_MAX_HEADER_LINES = 100
_MAX_LINE_LENGTH = 4096
_MAX_BYTES = 64 * MAX_PIXELS
_MAX_PIXELS_PER_POINT = 100


@dataclass(frozen=True)
class _Layout:
    """How rows are written: separator of fields, header line, columns of x, y and value, their units."""

    delimiter: str | None
    header: str | None
    columns: list[int]
    length_unit: str | None
    value_unit: str | None


def read_xyz(path: Path, quantity: Quantity, pixel_mm: float | None, unit: str | None) -> Table:
    """Read points on a uniform grid in any order; points that are absent or NaN become NaN.

    Without a header the columns are x, y and the value, and both the pixel size and the unit must be given.
    """
    where = f"{quantity.what} {path}"
    if path.stat().st_size > _MAX_BYTES:
        raise InputError(f"{where}: is larger than {_MAX_BYTES >> 30} GiB", "crop or bin the map")
    layout = _layout(_first_line(path, where), quantity, where)
    scale = quantity.scale(layout.value_unit, unit, where)
    rows = _rows(path, layout, where)
    x = uniform_axis(rows[:, 0], "x", where)
    y = uniform_axis(rows[:, 1], "y", where)
    check_size((y.size, x.size), where)
    if y.size * x.size > _MAX_PIXELS_PER_POINT * rows.shape[0]:
        raise InputError(
            f"{where}: its {rows.shape[0]} points fill next to nothing of a grid of {y.size} x {x.size}",
            "drop stray points, or interpolate the points to a uniform grid",
        )
    pitch = square_pitch(x.pitch, y.pitch, where)
    declared_mm = None if layout.length_unit is None else pitch * length_scale(layout.length_unit, where)
    pixel_mm = quantity.pixel_mm(declared_mm, pixel_mm, where)
    place = y.index * x.size + x.index
    if np.bincount(place).max() > 1:
        raise InputError(f"{where}: holds two values for one point", "drop the duplicates")
    values = np.full(y.size * x.size, np.nan)
    values[place] = rows[:, 2] * scale
    length_mm = pixel_mm / pitch
    return Table(values.reshape(y.size, x.size), pixel_mm, x.start * length_mm, y.start * length_mm)


def _first_line(path: Path, where: str) -> str:
    try:
        with path.open(encoding="utf-8-sig") as stream:
            for _ in range(_MAX_HEADER_LINES):
                line = stream.readline(_MAX_LINE_LENGTH)
                if line.lstrip(_COMMENT).strip():
                    return line.strip()
    except UnicodeDecodeError as error:
        raise InputError(f"{where}: is not a text file", "check the suffix of the file") from error
    raise InputError(f"{where}: holds no rows", "give one point per row")


def _layout(first: str, quantity: Quantity, where: str) -> _Layout:
    delimiter = next((mark for mark in (";", ",", "\t") if mark in first), None)
    text = first.lstrip(_COMMENT).strip()
    fields = text.split(delimiter) if delimiter else re.split(r"\s+(?![\[(])", text)
    if all(_is_number(field) for field in fields):
        return _Layout(delimiter, None, [0, 1, 2], None, None)
    split = [quantity.split(name) for name in fields]
    columns = []
    for stems in (("x",), ("y",), (quantity.stem, "z")):
        found = [index for index, (stem, _) in enumerate(split) if stem in stems]
        if len(found) != 1:
            raise InputError(
                f"{where}: needs exactly one column {' or '.join(stems)}, its first line is {first[:80]!r}",
                f"begin the file with a header like x_mm,y_mm,{quantity.example}",
            )
        columns.append(found[0])
    x_unit, y_unit, value_unit = (split[index][1] for index in columns)
    if x_unit != y_unit:
        raise InputError(
            f"{where}: mixed units, x is in {x_unit or 'no unit'} and y in {y_unit or 'no unit'}",
            "use one unit for both",
        )
    return _Layout(delimiter, first, columns, x_unit, value_unit)


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def _rows(path: Path, layout: _Layout, where: str) -> NDArray[np.float64]:
    try:
        with path.open(encoding="utf-8-sig") as stream, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # numpy only warns about a file without rows; it is refused below
            while layout.header is not None and stream.readline().strip() != layout.header:
                pass
            rows = np.loadtxt(
                stream,
                delimiter=layout.delimiter,
                usecols=layout.columns,
                ndmin=2,
                comments=_COMMENT,
            )
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{where}: {error}", "every row must hold numbers with a decimal point") from error
    if not 0 < rows.shape[0] <= MAX_PIXELS:
        raise InputError(f"{where}: holds {rows.shape[0]} points", f"give 1 to {MAX_PIXELS} points")
    return rows
