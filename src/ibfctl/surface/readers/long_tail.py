"""The long tail: whatever SurfaceTopography (an optional extra, MIT) reads, asked for by `surfacetopography:FILE`.

It takes a second to load and knows some forty formats of microscopes and profilers. Its rows come as the instruments
store them, top row first, and are turned over here as those of all pictures.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ibfctl.errors import InputError
from ibfctl.surface.readers.quantity import Quantity, length_scale
from ibfctl.surface.readers.table import Table, check_size, square_pitch

LONG_TAIL_PREFIX = "surfacetopography:"


def read_long_tail(path: Path, quantity: Quantity, pixel_mm: float | None, unit: str | None) -> Table:
    """Read the default channel of a file; what the library masks becomes NaN.

    Raises
    ------
    InputError
        If the extra is not installed, or the library cannot read the file.
    """
    where = f"{quantity.what} {path}"
    quantity.refuse_heights(where)
    try:
        from SurfaceTopography.IO import open_topography
    except ModuleNotFoundError as error:
        raise InputError(
            f"{where}: {LONG_TAIL_PREFIX} needs SurfaceTopography, which is not installed",
            "pip install 'ibfctl[long-tail]'",
        ) from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reader = open_topography(str(path))
            return _table(reader, quantity, pixel_mm, unit, where)
    except InputError:
        raise
    except Exception as error:  # it raises what its many readers raise
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{where}: SurfaceTopography cannot read it ({reason})", "check the file") from error


def _table(reader: Any, quantity: Quantity, pixel_mm: float | None, unit: str | None, where: str) -> Table:
    channel = reader.default_channel
    if channel.dim != 2:
        raise InputError(f"{where}: holds a line, not a surface", "give a map")
    nx, ny = channel.nb_grid_pts
    check_size((ny, nx), where)
    declared = channel.unit
    scale = quantity.scale(None if declared is None else str(declared).replace("µ", "u"), unit, where)
    declared_mm, given = None, {}
    if channel.physical_sizes is None:
        given["physical_sizes"] = (float(nx), float(ny))
    elif declared is not None:
        size_x, size_y = channel.physical_sizes
        length_mm = length_scale(str(declared).replace("µ", "u"), where)
        declared_mm = square_pitch(size_x / nx * length_mm, size_y / ny * length_mm, where)
    pixel_mm = quantity.pixel_mm(declared_mm, pixel_mm, where)
    heights = reader.topography(**given).heights()
    values = np.ma.filled(np.ma.asarray(heights, dtype=np.float64), np.nan)
    return Table(values.T[::-1] * scale, pixel_mm)
