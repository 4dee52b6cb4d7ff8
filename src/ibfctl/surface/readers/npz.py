"""NumPy archives: `height_nm` or `rate_nm_s` (ny, nx), `pixel_mm`, and optional `x0_mm`, `y0_mm`."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.surface.readers.quantity import Quantity
from ibfctl.surface.readers.table import Table, check_size


def read_npz(path: Path, quantity: Quantity, pixel_mm: float | None, unit: str | None) -> Table:
    """Read a table from a NumPy archive; pickled objects are refused."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = {name.removesuffix(".npy"): name for name in archive.namelist()}
            name, declared_unit = _table_name(list(members), quantity, path)
            scale = quantity.scale(declared_unit, unit, f"{quantity.what} {path}")
            with archive.open(members[name]) as stream:
                size = archive.getinfo(members[name]).file_size
                values = _read_array(stream, size, f"{quantity.what} {path}: {name}")
            scalars: dict[str, float] = {}
            for key in ("pixel_mm", "x0_mm", "y0_mm"):
                if key in members:
                    with archive.open(members[key]) as stream:
                        scalars[key] = _read_scalar(stream, f"{quantity.what} {path}: {key}")
    except InputError:
        raise
    except Exception as error:  # a damaged archive makes zipfile, zlib and numpy raise almost anything
        raise InputError(
            f"{quantity.what} {path}: is no readable .npz archive ({error})", "write it with numpy.savez"
        ) from error
    pixel_mm = quantity.pixel_mm(scalars.get("pixel_mm"), pixel_mm, f"{quantity.what} {path}")
    if ("x0_mm" in scalars) != ("y0_mm" in scalars):
        raise InputError(f"{quantity.what} {path}: holds only one of x0_mm and y0_mm", "give both or neither")
    return Table(values * scale, pixel_mm, scalars.get("x0_mm"), scalars.get("y0_mm"))


def _table_name(names: list[str], quantity: Quantity, path: Path) -> tuple[str, str | None]:
    tables = [(name, quantity.split(name)[1]) for name in names if quantity.split(name)[0] == quantity.stem]
    if len(tables) != 1:
        held = ", ".join(sorted(names)) or "nothing"
        raise InputError(
            f"{quantity.what} {path}: needs exactly one array named like {quantity.example}, it holds {held}",
            "store one table, with its unit in its name",
        )
    return tables[0]


def _header(stream: IO[bytes], where: str) -> tuple[tuple[int, ...], int]:
    """Return the shape that the array's header declares, and how many bytes it has without that header."""
    version = npy.read_magic(stream)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(stream)
    if dtype.hasobject or dtype.kind not in "fiu":
        raise InputError(f"{where}: holds {dtype} where real numbers are needed", "store it as float64")
    return tuple(shape), math.prod(shape) * dtype.itemsize


def _rewound(stream: IO[bytes]) -> NDArray[Any]:
    stream.seek(0)
    return npy.read_array(stream, allow_pickle=False)


def _read_array(stream: IO[bytes], size: int, where: str) -> NDArray[np.float64]:
    shape, needed = _header(stream, where)
    check_size(shape, where)
    if needed > size:
        raise InputError(f"{where}: is cut short, it declares {needed} bytes and holds {size}", "write it anew")
    return _rewound(stream).astype(np.float64, copy=False)


def _read_scalar(stream: IO[bytes], where: str) -> float:
    shape, _ = _header(stream, where)
    if any(side != 1 for side in shape):
        raise InputError(f"{where}: must be a single number, not of shape {shape}", "store one value")
    value = float(_rewound(stream).reshape(()))
    if not np.isfinite(value):
        raise InputError(f"{where}: is {value}, it must be a finite number", "correct the file")
    return value
