"""Nodes with dwell times that come from elsewhere: CSV with the columns `x_mm,y_mm,dwell_s`."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError

FloatArray = NDArray[np.float64]
_COLUMNS = ("x_mm", "y_mm", "dwell_s")


@dataclass(frozen=True)
class TimedNodes:
    """Nodes in order.

    Attributes
    ----------
    x_mm, y_mm, dwell_s : (n,) float64
        `dwell_s` is the time of the segment that ends at the node, 0 at the first.
    """

    x_mm: FloatArray
    y_mm: FloatArray
    dwell_s: FloatArray


def read_timed_nodes(path: Path) -> TimedNodes:
    """Read timed nodes.

    Raises
    ------
    InputError
        If the file cannot be read, its columns are not the three above, or a row holds no three numbers.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            rows = csv.reader(stream)
            header = tuple(name.strip() for name in next(rows, []))
            if header != _COLUMNS:
                raise InputError(
                    f"timed nodes {path}: first line is {','.join(header)!r}",
                    f"begin with {','.join(_COLUMNS)}",
                )
            table = np.array([_numbers(row, line, path) for line, row in enumerate(rows, start=2) if row])
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"timed nodes {path}: cannot be read ({error})", "check the path") from error
    if len(table) < 2:
        raise InputError(f"timed nodes {path}: holds {len(table)} nodes", "give at least two")
    if table[0, 2] != 0:
        raise InputError(f"timed nodes {path}: dwell_s of the first node is {table[0, 2]:g}", "it must be 0")
    if (table[1:, 2] <= 0).any():
        line = int(np.argmax(table[1:, 2] <= 0)) + 3
        raise InputError(f"timed nodes {path}: dwell_s in line {line} is not positive", "give every segment a time")
    return TimedNodes(*np.ascontiguousarray(table.T))


def _numbers(row: list[str], line: int, path: Path) -> tuple[float, float, float]:
    try:
        x_mm, y_mm, dwell_s = (float(field) for field in row)
    except ValueError as error:
        raise InputError(f"timed nodes {path}: line {line} holds no three numbers", "correct it") from error
    if not np.isfinite([x_mm, y_mm, dwell_s]).all():
        raise InputError(f"timed nodes {path}: line {line} holds a value that is not finite", "correct it")
    return x_mm, y_mm, dwell_s
