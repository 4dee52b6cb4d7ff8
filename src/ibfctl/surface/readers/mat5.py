"""Named real matrices of a MATLAB version 5 file, without believing any size that it declares.

Source: MAT-File Format, MathWorks, chapter 1 (version 5): tags of type and size, small elements inside their tag,
padding to 8 bytes, zlib streams for compressed elements, columns first.
"""

from __future__ import annotations

import math
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError

_MAX_ITEM_BYTES = 8
_HEADER_BYTES, _TAG_BYTES, _HEAD_BYTES = 128, 8, 4096
_MATRIX, _COMPRESSED = 14, 15
_DTYPE = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
_NUMERIC_CLASSES = range(6, 16)
_COMPLEX = 0x0800


@dataclass(frozen=True)
class Matrix:
    """A matrix as its header declares it.

    Attributes
    ----------
    name, shape
        As stored.
    real
        Whether it holds real numbers, and can be read.
    """

    name: str
    shape: tuple[int, ...]
    real: bool
    order: str
    place: int
    size: int
    compressed: bool


def matrices(path: Path, where: str) -> dict[str, Matrix]:
    """Return what a file holds, by name; nothing but headers is unpacked.

    Raises
    ------
    InputError
        If it is no file of this version, or is cut short.
    """
    with path.open("rb") as stream:
        return {matrix.name: matrix for matrix in _listed(stream, where)}


def read_matrix(path: Path, matrix: Matrix, where: str) -> NDArray[np.float64]:
    """Read one real matrix, of a shape that the caller has checked; nothing beyond that shape is unpacked.

    Raises
    ------
    InputError
        If it holds no real numbers, other than it declares, or is damaged.
    """
    if not matrix.real:
        raise InputError(f"{where}: does not hold real numbers", "store it as a real matrix")
    with path.open("rb") as stream:
        stream.seek(matrix.place)
        body = stream.read(matrix.size)
    if matrix.compressed:
        body = _inflated(body, _HEAD_BYTES + _MAX_ITEM_BYTES * math.prod(matrix.shape), where)[_TAG_BYTES:]
    *_, (kind, data) = _elements(memoryview(body), matrix.order, 4, where)
    dtype = np.dtype(matrix.order + _DTYPE[kind]) if kind in _DTYPE else None
    if dtype is None or len(data) != dtype.itemsize * math.prod(matrix.shape):
        raise InputError(f"{where}: its values do not make up its shape {matrix.shape}", "save it anew")
    return np.frombuffer(data, dtype).reshape(matrix.shape, order="F").astype(np.float64)


def _listed(stream: IO[bytes], where: str) -> Iterator[Matrix]:
    header = stream.read(_HEADER_BYTES)
    order = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}.get(header[-4:])
    if len(header) < _HEADER_BYTES or order is None:
        raise InputError(f"{where}: is no MATLAB version 5 file", "save it in MATLAB with the option -v7")
    end = os.fstat(stream.fileno()).st_size
    place = _HEADER_BYTES
    while place < end:
        stream.seek(place)
        tag = stream.read(_TAG_BYTES)
        kind, size = struct.unpack(f"{order}II", tag) if len(tag) == _TAG_BYTES else (0, end)
        place += _TAG_BYTES + size
        if place > end:
            raise InputError(f"{where}: is cut short", "copy the file again")
        head = stream.read(min(size, _HEAD_BYTES))
        if kind == _COMPRESSED:
            head = _inflated(head, _HEAD_BYTES, where)
            kind = struct.unpack_from(f"{order}I", head)[0] if len(head) >= _TAG_BYTES else 0
            head, compressed = head[_TAG_BYTES:], True
        else:
            compressed = False
        if kind == _MATRIX:
            yield _described(head, order, place - size, size, compressed, where)


def _described(head: bytes, order: str, place: int, size: int, compressed: bool, where: str) -> Matrix:
    (_, flags), (_, dimensions), (_, name) = _elements(memoryview(head), order, 3, where)
    if len(flags) < 4 or len(dimensions) % 4:
        raise InputError(f"{where}: has a damaged header of a matrix", "copy the file again")
    (flag,) = struct.unpack_from(f"{order}I", flags)
    shape = struct.unpack(f"{order}{len(dimensions) // 4}i", dimensions)
    if min(shape, default=-1) < 0:
        raise InputError(f"{where}: has a damaged header of a matrix", "copy the file again")
    real = flag & 0xFF in _NUMERIC_CLASSES and not flag & _COMPLEX
    return Matrix(bytes(name).decode("latin-1"), shape, real, order, place, size, compressed)


def _elements(body: memoryview, order: str, count: int, where: str) -> list[tuple[int, memoryview]]:
    """Return the types and contents of the first `count` elements of a matrix."""
    found: list[tuple[int, memoryview]] = []
    place = 0
    while len(found) < count:
        if place + _TAG_BYTES > len(body):
            raise InputError(f"{where}: is cut short", "copy the file again")
        kind, size = struct.unpack_from(f"{order}II", body, place)
        if kind >> 16:  # a small element: its size and up to 4 bytes share the tag with its type
            kind, size, start = kind & 0xFFFF, kind >> 16, place + 4
            following = place + _TAG_BYTES
        else:
            start = place + _TAG_BYTES
            following = start + -(-size // 8) * 8
        if start + size > len(body):
            raise InputError(f"{where}: is cut short", "copy the file again")
        found.append((kind, body[start : start + size]))
        place = following
    return found


def _inflated(packed: bytes, limit: int, where: str) -> bytes:
    try:
        return zlib.decompressobj().decompress(packed, limit)
    except zlib.error as error:
        raise InputError(f"{where}: is damaged ({error})", "copy the file again") from error
