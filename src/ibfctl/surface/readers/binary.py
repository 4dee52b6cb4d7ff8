"""Tables that lie uncompressed in a file: how long the file must be is known before anything is allocated."""

from __future__ import annotations

import os
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.surface.readers.table import check_size


def read_bytes(stream: IO[bytes], offset: int, count: int, where: str) -> bytes:
    """Read exactly `count` bytes at `offset`.

    Raises
    ------
    InputError
        If the file is shorter.
    """
    size = os.fstat(stream.fileno()).st_size
    if offset + count > size:
        raise InputError(
            f"{where}: is cut short, it declares {offset + count} bytes and holds {size}", "copy the file again"
        )
    stream.seek(offset)
    return stream.read(count)


def read_table(
    stream: IO[bytes], offset: int, dtype: np.dtype[Any], shape: tuple[int, int], where: str
) -> NDArray[Any]:
    """Read a table of `shape` (ny, nx) at `offset`, row after row.

    Raises
    ------
    InputError
        If this is the shape of no map, or the file is shorter than it declares.
    """
    check_size(shape, where)
    content = read_bytes(stream, offset, shape[0] * shape[1] * dtype.itemsize, where)
    return np.frombuffer(content, dtype).reshape(shape)
