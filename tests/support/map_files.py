"""Maps written byte by byte as the descriptions of the formats say, by code that shares nothing with the readers.

Every writer takes heights (ny, nx) in nm with y upwards, NaN where there is no data.
"""

from __future__ import annotations

import struct
from pathlib import Path

import h5py
import numpy as np

NO_PHASE = 2147483647
WAVELENGTH_M = 632.8e-9


def hill_nm(ny: int = 5, nx: int = 7) -> np.ndarray:
    """A map without any symmetry, and two pixels without data."""
    y, x = np.mgrid[:ny, :nx]
    height_nm = 3.0 * x - 2.0 * y + 0.5 * x * y
    height_nm[0, -1] = height_nm[-1, 1] = np.nan
    return height_nm


def write_metropro(
    path: Path,
    height_nm: np.ndarray,
    pixel_mm: float = 0.5,
    *,
    magic: int = 0x881B036F,
    camera: tuple[int, int, int] = (4, 3, 2),
    resolution: int = 2,
    inverted: int = 0,
) -> Path:
    """MetroPro: big-endian header, intensity frames, phase in counts of a fringe, top row first."""
    ny, nx = height_nm.shape
    header = bytearray(4096 if magic == 0x881B0371 else 834)
    struct.pack_into(">IHI", header, 0, magic, 1, len(header))
    struct.pack_into(">HHH", header, 52, *camera)
    struct.pack_into(">HH", header, 68, nx, ny)
    struct.pack_into(">ff", header, 164, 0.5, WAVELENGTH_M)
    struct.pack_into(">f", header, 176, 1.0)
    struct.pack_into(">f", header, 184, pixel_mm / 1e3)
    struct.pack_into(">h", header, 218, resolution)
    struct.pack_into(">h", header, 232, inverted)
    nm_per_count = 0.5 * WAVELENGTH_M * 1e9 / {0: 4096, 1: 32768, 2: 131072}[resolution]
    counts = np.where(np.isnan(height_nm), NO_PHASE, np.rint(height_nm / nm_per_count))
    frames = bytes(2 * camera[0] * camera[1] * camera[2])
    path.write_bytes(bytes(header) + frames + counts[::-1].astype(">i4").tobytes())
    return path


def write_fits(path: Path, stored: np.ndarray, bitpix: int, **cards: object) -> Path:
    """FITS: cards of 80 characters, blocks of 2880 bytes, big-endian values, lowest row first."""
    ny, nx = stored.shape
    header: dict[str, object] = {"SIMPLE": True, "BITPIX": bitpix, "NAXIS": 2, "NAXIS1": nx, "NAXIS2": ny, **cards}

    def text(value: object) -> str:
        if isinstance(value, bool):
            return f"{'T' if value else 'F':>20}"
        return f"'{value:<8}'" if isinstance(value, str) else f"{value!r:>20}"

    lines = [f"{key:<8}= {text(value)} / about {key}" for key, value in header.items()]
    head = "".join(f"{line:<80}" for line in ["COMMENT = made for a test", *lines, "END"][1:])
    kind = {8: "u1", 16: ">i2", 32: ">i4", 64: ">i8", -32: ">f4", -64: ">f8"}[bitpix]
    path.write_bytes(_blocks(head.encode(), b" ") + _blocks(stored.astype(kind).tobytes(), b"\0"))
    return path


def _blocks(content: bytes, filling: bytes) -> bytes:
    return content.ljust(-(-len(content) // 2880) * 2880, filling)


def write_tiff(
    path: Path,
    stored: np.ndarray,
    *,
    order: str = "<",
    rows_per_strip: int | None = None,
    tile: tuple[int, int] | None = None,
    **changed: tuple[int, int],
) -> Path:
    """TIFF: the image's parts behind the header, then the directory; `stored` with its top row first.

    `changed` overwrites tags: `tag_259=(3, 5)` gives tag 259 the type 3 (SHORT) and the value 5.
    """
    ny, nx = stored.shape
    stored = stored.astype(stored.dtype.newbyteorder(order))
    if tile is None:
        rows = rows_per_strip or ny
        parts = [stored[row : row + rows].tobytes() for row in range(0, ny, rows)]
    else:
        full = np.zeros([-(-size // side) * side for size, side in zip(stored.shape, tile, strict=True)], stored.dtype)
        full[:ny, :nx] = stored
        places = [(r, c) for r in range(0, ny, tile[0]) for c in range(0, nx, tile[1])]
        parts = [full[r : r + tile[0], c : c + tile[1]].tobytes() for r, c in places]
    offsets = 8 + np.cumsum([0, *map(len, parts)])[:-1]
    body = b"".join(parts)
    sizes = [len(part) for part in parts]
    longs = struct.pack(f"{order}{2 * len(parts)}I", *offsets, *sizes)
    at_longs = 8 + len(body)
    sample = {"u": 1, "i": 2, "f": 3}[stored.dtype.kind]
    several = len(parts) > 1
    where = (4, len(parts), at_longs if several else int(offsets[0]))
    size = (4, len(parts), at_longs + 4 * len(parts) if several else sizes[0])
    tags = {256: (4, 1, nx), 257: (4, 1, ny), 258: (3, 1, 8 * stored.itemsize), 259: (3, 1, 1), 262: (3, 1, 1)}
    tags |= {277: (3, 1, 1), 339: (3, 1, sample)}
    tags |= (
        {273: where, 278: (4, 1, rows), 279: size}
        if tile is None
        else {322: (4, 1, tile[1]), 323: (4, 1, tile[0]), 324: where, 325: size}
    )
    tags |= {int(name.removeprefix("tag_")): (kind, 1, value) for name, (kind, value) in changed.items()}
    entries = b"".join(
        struct.pack(f"{order}HHI", tag, kind, count)
        + (struct.pack(f"{order}HH", value, 0) if kind == 3 else struct.pack(f"{order}I", value))
        for tag, (kind, count, value) in sorted(tags.items())
    )
    directory = struct.pack(f"{order}H", len(tags)) + entries + bytes(4)
    start = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}I", at_longs + len(longs))
    path.write_bytes(start + body + longs + directory)
    return path


def write_datx(
    path: Path, stored: np.ndarray, pixel_mm: float = 0.5, unit: bytes = b"NanoMeters", no_data: float = 1e300
) -> Path:
    """Mx: what the public readers of it look for; `stored` with its top row first."""
    text = h5py.string_dtype("ascii")
    converter = np.dtype([("Category", text), ("BaseUnit", text), ("Parameters", "f8", (4,))])
    lateral = np.array([(b"LateralCat", b"Pixels", [0.0, pixel_mm / 1e3, 0.0, 0.0])], dtype=converter)
    height = np.array([(b"HeightCat", unit, [0.0, 1.0, 0.0, 0.0])], dtype=converter)
    with h5py.File(path, "w") as file:
        surface = file.create_dataset("Data/Surface/{SURFACE}", data=np.where(np.isnan(stored), no_data, stored))
        surface.attrs["Unit"] = np.array([unit], dtype=text)
        surface.attrs["No Data"] = [no_data]
        surface.attrs["Interferometric Scale Factor"] = [0.5]
        surface.attrs["Obliquity Factor"] = [1.0]
        surface.attrs["Wavelength"] = [WAVELENGTH_M]
        surface.attrs["X Converter"] = surface.attrs["Y Converter"] = lateral
        surface.attrs["Z Converter"] = height
        file.create_group("Attributes/{ATTRIBUTES}").attrs["Resolution"] = [pixel_mm / 1e3]
    return path


def write_mat73(path: Path, **arrays: np.ndarray) -> Path:
    """MATLAB 7.3: 512 bytes of its own before the HDF5 file, dimensions in reverse order."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in arrays.items():
            file.create_dataset(name, data=np.atleast_2d(values).T).attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path
