"""TIFF files (`.tif`, `.tiff`) with one uncompressed grey image of numbers: float32, float64, or integers.

Source: TIFF Revision 6.0, sections 2 (structure), 4 (grey images), 15 (tiles) and 19 (data sample format). The first
row is the top of the image; the rows are turned over, so that y grows upwards. A TIFF says neither what its values
nor how large its pixels are on the part: its resolution is meant for printing. NaN is no data, and so is the value
in the tag GDAL_NODATA where there is one.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.surface.readers.binary import read_bytes, read_table
from ibfctl.surface.readers.quantity import Quantity
from ibfctl.surface.readers.table import Table, check_size

_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC, _ORIENTATION, _SAMPLES = 256, 257, 258, 259, 262, 274, 277
_STRIP_OFFSETS, _ROWS_PER_STRIP, _TILE_WIDTH, _TILE_HEIGHT, _TILE_OFFSETS = 273, 278, 322, 323, 324
_SAMPLE_FORMAT, _GDAL_NODATA = 339, 42113
_NOT_COMPRESSED, _BLACK_IS_ZERO, _TOP_LEFT, _BOTTOM_LEFT = 1, 1, 1, 4
_KIND = {1: "u", 2: "i", 3: "f"}
_NUMBER = {1: "u1", 3: "u2", 4: "u4"}  # BYTE, SHORT, LONG
_MAX_PARTS = 1 << 16
_ASCII, _MAX_TEXT = 2, 64

Tags = dict[int, NDArray[Any] | str]


def read_tiff(path: Path, quantity: Quantity, pixel_mm: float | None, unit: str | None) -> Table:
    """Read the image; its unit and its pixel size must be given."""
    where = f"{quantity.what} {path}"
    scale = quantity.scale(None, unit, where)
    pixel_mm = quantity.pixel_mm(None, pixel_mm, where)
    with path.open("rb") as stream:
        order, tags = _directory(stream, where)
        stored = _image(stream, order, tags, where)
    values = stored * scale
    no_data = tags.get(_GDAL_NODATA)
    if isinstance(no_data, str):
        try:
            values[stored == float(no_data)] = np.nan
        except ValueError as error:
            raise InputError(f"{where}: its value for no data is {no_data!r}", "save it anew") from error
    return Table(values if _one(tags, _ORIENTATION, 1, where) == _BOTTOM_LEFT else values[::-1], pixel_mm)


def _directory(stream: IO[bytes], where: str) -> tuple[str, Tags]:
    """Return the order of bytes, and the tags that matter here."""
    start = read_bytes(stream, 0, 8, where)
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(start[:4])
    if order is None:
        raise InputError(f"{where}: is no (classic) TIFF file", "check the suffix of the file")
    (place,) = struct.unpack_from(f"{order}I", start, 4)
    (entries,) = struct.unpack(f"{order}H", read_bytes(stream, place, 2, where))
    directory = read_bytes(stream, place + 2, 12 * entries + 4, where)
    if directory[-4:] != bytes(4):
        raise InputError(f"{where}: holds more than one image", "save the map alone")
    tags: Tags = {}
    for tag, kind, count, value in struct.iter_unpack(f"{order}HHI4s", directory[:-4]):
        text = tag == _GDAL_NODATA and kind == _ASCII
        if (kind not in _NUMBER and not text) or count > (_MAX_TEXT if text else _MAX_PARTS):
            continue
        dtype = np.dtype("u1" if text else order + _NUMBER[kind])
        size = dtype.itemsize * count
        (at,) = struct.unpack(f"{order}I", value)
        content = value[:size] if size <= len(value) else read_bytes(stream, at, size, where)
        tags[tag] = content.rstrip(b"\0 ").decode("latin-1") if text else np.frombuffer(content, dtype)
    return order, tags


def _image(stream: IO[bytes], order: str, tags: Tags, where: str) -> NDArray[Any]:
    ny, nx = (_one(tags, tag, 0, where) for tag in (_HEIGHT, _WIDTH))
    check_size((ny, nx), where)
    dtype = _dtype(order, tags, where)
    tiled = _TILE_OFFSETS in tags
    tile_ny = _one(tags, _TILE_HEIGHT if tiled else _ROWS_PER_STRIP, ny, where)
    tile_nx = _one(tags, _TILE_WIDTH, nx, where) if tiled else nx
    offsets = tags.get(_TILE_OFFSETS if tiled else _STRIP_OFFSETS, ())
    tile_ny = tile_ny if tiled else min(tile_ny, ny)
    check_size((tile_ny, tile_nx), where)
    if not (ny and nx and tile_ny and tile_nx) or len(offsets) != -(-ny // tile_ny) * -(-nx // tile_nx):
        raise InputError(f"{where}: its parts do not make up {ny} x {nx} pixels", "save it anew")
    read_bytes(stream, ny * nx * dtype.itemsize, 0, where)  # the file must be as long at least
    image = np.empty((ny, nx), dtype)
    places = ((row, column) for row in range(0, ny, tile_ny) for column in range(0, nx, tile_nx))
    for (row, column), offset in zip(places, offsets, strict=True):
        rows = tile_ny if tiled else min(tile_ny, ny - row)
        part = read_table(stream, int(offset), dtype, (rows, tile_nx), where)
        image[row : row + rows, column : column + tile_nx] = part[: ny - row, : nx - column]
    return image


def _dtype(order: str, tags: Tags, where: str) -> np.dtype[Any]:
    kind, bits = _KIND.get(_one(tags, _SAMPLE_FORMAT, 1, where)), _one(tags, _BITS, 1, where)
    found = {
        "compression": _one(tags, _COMPRESSION, _NOT_COMPRESSED, where) == _NOT_COMPRESSED,
        "samples per pixel": _one(tags, _SAMPLES, 1, where) == 1,
        "colours": _one(tags, _PHOTOMETRIC, _BLACK_IS_ZERO, where) == _BLACK_IS_ZERO,
        "orientation": _one(tags, _ORIENTATION, _TOP_LEFT, where) in (_TOP_LEFT, _BOTTOM_LEFT),
        f"kind of numbers ({bits} bits)": (kind, bits) in {(k, b) for k in "uif" for b in (8, 16, 32, 64)} - {("f", 8)},
    }
    if not all(found.values()):
        wrong = ", ".join(name for name, fits in found.items() if not fits)
        raise InputError(
            f"{where}: its {wrong} cannot be read", "save it as one uncompressed grey image of 32-bit floating point"
        )
    return np.dtype(f"{order}{kind}{bits // 8}")


def _one(tags: Tags, tag: int, default: int, where: str) -> int:
    value = tags.get(tag, (default,))
    if isinstance(value, str) or len(value) != 1:
        raise InputError(f"{where}: its tag {tag} must be one number", "save it as one uncompressed grey image")
    return int(value[0])
