"""Nodes from a CSV file."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.path.raster import MAX_NODES
from ibfctl.path.tool_path import ToolPath

FloatArray = NDArray[np.float64]


def read_nodes(path: Path) -> ToolPath:
    """Read a path of nodes: columns `x_mm,y_mm`."""
    x_mm, y_mm = read_columns(path, ("x_mm", "y_mm"))
    return ToolPath(x_mm, y_mm)


def read_columns(path: Path, names: tuple[str, ...]) -> tuple[FloatArray, ...]:
    """Read named columns of a CSV file with a header; other columns are left alone.

    Raises
    ------
    InputError
        If the file cannot be read, a column is missing, or a field is no finite number, with its line.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.reader(file)
            header = [name.strip() for name in next(rows, [])]
            missing = [name for name in names if name not in header]
            if missing:
                raise InputError(
                    f"{path}: column {', '.join(missing)} missing; the first line is {','.join(header)[:80]!r}",
                    f"the first line must name the columns {','.join(names)}",
                )
            places = [header.index(name) for name in names]
            values: list[list[float]] = []
            for row in rows:
                if len(values) > MAX_NODES:
                    raise InputError(f"{path}: more than {MAX_NODES} rows", "split the job")
                if row:
                    values.append(_numbers(row, places, path, rows.line_num))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read ({error})", "give a CSV file in UTF-8") from error
    if len(values) < 2:
        raise InputError(f"{path}: holds {len(values)} rows", "give at least two nodes")
    return tuple(np.array(values, dtype=np.float64).T.copy())


def _numbers(row: list[str], places: list[int], path: Path, line: int) -> list[float]:
    try:
        numbers = [float(row[place]) for place in places]
    except (ValueError, IndexError):
        numbers = [float("nan")]
    if not np.isfinite(numbers).all():
        raise InputError(f"{path}: line {line} is not finite numbers: {','.join(row)[:80]!r}", "correct that line")
    return numbers
