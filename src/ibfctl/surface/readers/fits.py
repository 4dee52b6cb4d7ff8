"""FITS files (`.fits`, `.fit`): the primary image of two dimensions.

Source: FITS Standard 4.0, sections 3 (organisation), 4.4 (keywords), 5 (data) and 8 (coordinates). The first row is
the lowest: y grows with the row, as here. The unit of the values is `BUNIT`; `CDELTn` gives the pixel size where
`CUNITn` is a length.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import IO

import numpy as np

from ibfctl.errors import InputError
from ibfctl.surface.readers.binary import read_bytes, read_table
from ibfctl.surface.readers.quantity import Quantity
from ibfctl.surface.readers.table import Table, square_pitch
from ibfctl.units import LENGTH_IN_MM

_BLOCK_BYTES, _CARD_BYTES, _MAX_BLOCKS = 2880, 80, 200
_DTYPE = {8: "u1", 16: ">i2", 32: ">i4", 64: ">i8", -32: ">f4", -64: ">f8"}
_CARD = re.compile(r"([A-Z0-9_-]{1,8}) *= *('(?:[^']|'')*'|[^/]*)")
_ROTATED = re.compile(r"(PC|CD)\d+_\d+|CROTA\d+")

Header = dict[str, str]


def read_fits(path: Path, quantity: Quantity, pixel_mm: float | None, unit: str | None) -> Table:
    """Read the primary image; `BLANK` becomes NaN."""
    where = f"{quantity.what} {path}"
    with path.open("rb") as stream:
        header, offset = _header(stream, where)
        axes = [_integer(header, f"NAXIS{n + 1}", where) for n in range(min(_integer(header, "NAXIS", where), 9))]
        dtype = _DTYPE.get(_integer(header, "BITPIX", where))
        if len(axes) < 2 or min(axes) < 1 or max([1, *axes[2:]]) > 1 or dtype is None:
            raise InputError(f"{where}: its first part is no image of two dimensions", "save the map as primary image")
        stored = read_table(stream, offset, np.dtype(dtype), (axes[1], axes[0]), where)
    scale = quantity.scale(_unit(header), unit, where)
    values = stored * (_number(header, "BSCALE", 1.0, where) * scale)
    values += _number(header, "BZERO", 0.0, where) * scale
    if stored.dtype.kind != "f" and "BLANK" in header:
        values[stored == _integer(header, "BLANK", where)] = np.nan
    return _placed(values, header, quantity, pixel_mm, where)


def _header(stream: IO[bytes], where: str) -> tuple[Header, int]:
    """Return the cards with a value, and where the data begin."""
    header: Header = {}
    for block in range(_MAX_BLOCKS):
        text = read_bytes(stream, block * _BLOCK_BYTES, _BLOCK_BYTES, where).decode("latin-1")
        if block == 0 and not text.startswith("SIMPLE  ="):
            raise InputError(f"{where}: is no FITS file", "check the suffix of the file")
        for start in range(0, _BLOCK_BYTES, _CARD_BYTES):
            card = text[start : start + _CARD_BYTES]
            if card.rstrip() == "END":
                return header, (block + 1) * _BLOCK_BYTES
            if match := _CARD.match(card):
                header[match[1]] = match[2].strip()
    raise InputError(f"{where}: its header does not end", "copy the file again")


def _placed(
    values: np.ndarray[tuple[int, int], np.dtype[np.float64]],
    header: Header,
    quantity: Quantity,
    pixel_mm: float | None,
    where: str,
) -> Table:
    units = [_text(header, f"CUNIT{n}") for n in (1, 2)]
    known = all(unit in LENGTH_IN_MM for unit in units) and not any(map(_ROTATED.fullmatch, header))
    if not known or "CDELT1" not in header or "CDELT2" not in header:
        return Table(values, quantity.pixel_mm(None, pixel_mm, where))
    step_mm, start_mm = [], []
    for n, length in enumerate(units, 1):
        step = _number(header, f"CDELT{n}", 0.0, where)
        first = _number(header, f"CRVAL{n}", 0.0, where) + (1 - _number(header, f"CRPIX{n}", 0.0, where)) * step
        size = values.shape[2 - n]
        step_mm.append(step * LENGTH_IN_MM[length])
        start_mm.append(min(first, first + (size - 1) * step) * LENGTH_IN_MM[length])
    declared_mm = square_pitch(abs(step_mm[0]), abs(step_mm[1]), where)
    upright = values[:: 1 if step_mm[1] > 0 else -1, :: 1 if step_mm[0] > 0 else -1]
    pixel = quantity.pixel_mm(declared_mm, pixel_mm, where)
    return Table(upright, pixel, *start_mm) if "CRPIX1" in header else Table(upright, pixel)


def _unit(header: Header) -> str | None:
    return _text(header, "BUNIT").replace(" s-1", "/s").replace(".s-1", "/s") or None


def _text(header: Header, key: str) -> str:
    return header.get(key, "").strip("'").strip()


def _integer(header: Header, key: str, where: str) -> int:
    text = header.get(key, "")
    if not re.fullmatch(r"[+-]?\d{1,20}", text):
        raise InputError(f"{where}: its header has no whole number {key}", "save it anew")
    return int(text)


def _number(header: Header, key: str, default: float, where: str) -> float:
    try:
        value = float(header.get(key, repr(default)).replace("D", "E"))
    except ValueError as error:
        raise InputError(f"{where}: {key} in its header is no number", "save it anew") from error
    if not np.isfinite(value):
        raise InputError(f"{where}: {key} in its header is {value}", "save it anew")
    return value
