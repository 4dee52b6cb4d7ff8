"""Zygo MetroPro binary files (`.dat`): connected phase as integers, heights in metres by the header's factors.

Source of the layout: MetroPro Reference Guide, OMP-0347, "Binary data format". The header is big-endian. Its magic
number tells its size (834 or 4096 bytes); intensity frames of 16 bits follow it, then the phase of 32 bits, the top
row of the camera's picture first.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from ibfctl.errors import InputError
from ibfctl.surface.readers.binary import read_bytes, read_table
from ibfctl.surface.readers.quantity import Quantity
from ibfctl.surface.readers.table import Table
from ibfctl.units import MM_PER_M

_HEADER_BYTES = {0x881B036F: 834, 0x881B0370: 834, 0x881B0371: 4096}
_SHORTEST_HEADER_BYTES = 834
_NO_DATA = 2147483640
_COUNTS_PER_FRINGE = {0: 4096, 1: 32768, 2: 131072}


def read_metropro(path: Path, quantity: Quantity, pixel_mm: float | None, unit: str | None) -> Table:
    """Read the connected phase of a MetroPro file as heights; pixels without data become NaN.

    The rows are turned over, so that y grows upwards in the camera's picture.
    """
    where = f"{quantity.what} {path}"
    quantity.refuse_heights(where)
    scale = quantity.scale("m", unit, where)
    with path.open("rb") as stream:
        header = read_bytes(stream, 0, _SHORTEST_HEADER_BYTES, where)
        magic, _, declared_bytes = struct.unpack_from(">IHI", header)
        if magic not in _HEADER_BYTES:
            raise InputError(f"{where}: is no MetroPro file", "check the suffix of the file")
        if declared_bytes != _HEADER_BYTES[magic]:
            raise InputError(f"{where}: its header declares {declared_bytes} bytes", "save it anew in MetroPro")
        camera_nx, camera_ny, frames = struct.unpack_from(">HHH", header, 52)
        nx, ny = struct.unpack_from(">HH", header, 68)
        if not (nx and ny):
            raise InputError(f"{where}: holds no phase", "save the surface, not the intensity alone")
        offset = declared_bytes + 2 * camera_nx * camera_ny * frames
        phase = read_table(stream, offset, np.dtype(">i4"), (ny, nx), where)
    metres = _metres_per_count(header, where)
    values = np.where(phase < _NO_DATA, phase * (metres * scale), np.nan)
    (lateral_m,) = struct.unpack_from(">f", header, 184)
    declared_mm = float(f"{lateral_m * MM_PER_M:.7g}") if lateral_m else None  # zero: not calibrated
    return Table(values[::-1], quantity.pixel_mm(declared_mm, pixel_mm, where))


def _metres_per_count(header: bytes, where: str) -> float:
    factor, wavelength_m = struct.unpack_from(">ff", header, 164)
    (obliquity,) = struct.unpack_from(">f", header, 176)
    (resolution,) = struct.unpack_from(">h", header, 218)
    (inverted,) = struct.unpack_from(">h", header, 232)
    if inverted:
        raise InputError(
            f"{where}: its data sign is inverted, which programs read in different ways",
            "save it from MetroPro with the data sign normal",
        )
    metres = factor * wavelength_m * obliquity / _COUNTS_PER_FRINGE.get(resolution, np.nan)
    if not 0 < metres < 1:
        raise InputError(
            f"{where}: its header gives no height of a fringe (scale {factor:g}, wavelength {wavelength_m:g} m, "
            f"obliquity {obliquity:g}, resolution {resolution})",
            "save it anew in MetroPro",
        )
    return float(metres)
