"""Maps for other programs: one writer per suffix. All that is written can be read back by `read_map`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from ibfctl.errors import InputError
from ibfctl.files import atomic_path, save_npz
from ibfctl.hdf5 import new_file
from ibfctl.surface.map import SurfaceMap
from ibfctl.units import MM_PER_M

_NO_DATA = float(np.finfo(np.float64).max)
_WAVELENGTH_M = 632.8e-9  # of the instruments that the format comes from; heights in nm do not use it


def write_map(surface: SurfaceMap, path: Path) -> None:
    """Write a map, completely or not at all, in the format that its suffix tells.

    Raises
    ------
    InputError
        If no map is written with this suffix, or the file cannot be written.
    """
    write = _WRITERS.get(path.suffix.lower())
    if write is None:
        raise InputError(
            f"output {path}: maps are not written as {path.suffix or 'a file without suffix'}",
            f"give one of {', '.join(_WRITERS)}",
        )
    write(surface, path)


def _write_npz(surface: SurfaceMap, path: Path) -> None:
    save_npz(path, height_nm=surface.height_nm, **_place(surface))


def _write_text(surface: SurfaceMap, path: Path) -> None:
    """One row per pixel that holds data."""
    x_mm, y_mm = np.meshgrid(surface.x_mm, surface.y_mm)
    valid = np.isfinite(surface.height_nm)
    with atomic_path(path) as partial:
        np.savetxt(
            partial,
            np.column_stack([x_mm[valid], y_mm[valid], surface.height_nm[valid]]),
            fmt="%.9g",
            delimiter=",",
            header="x_mm,y_mm,height_nm",
            comments="",
        )


def _write_hdf5(surface: SurfaceMap, path: Path) -> None:
    with new_file(path) as file:
        dataset = file.create_dataset("height_nm", data=surface.height_nm, compression="gzip", shuffle=True)
        dataset.attrs.update(_place(surface))
        dataset.attrs["unit"] = "nm"


def _write_datx(surface: SurfaceMap, path: Path) -> None:
    """Mx's layout as far as its public readers know it: see `readers.datx`. The place on the part is not in it."""
    text = h5py.string_dtype("ascii")
    converter = np.dtype([("Category", text), ("BaseUnit", text), ("Parameters", np.float64, (4,))])
    lateral = np.array([(b"LateralCat", b"Pixels", [0.0, surface.pixel_mm / MM_PER_M, 0.0, 0.0])], converter)
    height = np.array([(b"HeightCat", b"NanoMeters", [0.0, 1.0, 0.0, 0.0])], converter)
    link = np.dtype([("Source", text), ("Link", text), ("Destination", text)])
    links = [
        (b"Root", b"Measurement", b"{Measurement}"),
        (b"{Measurement}", b"Surface", b"{Surface}"),
        (b"{Surface}", b"Path", b"/Data/Surface/{Surface}"),
    ]
    stored = np.where(np.isnan(surface.height_nm), _NO_DATA, surface.height_nm)[::-1]
    with new_file(path) as file:
        file.create_dataset("MetaData", data=np.array(links, link))
        dataset = file.create_dataset("Data/Surface/{Surface}", data=stored)
        dataset.attrs["Unit"] = np.array([b"NanoMeters"], text)
        dataset.attrs["No Data"] = [_NO_DATA]
        dataset.attrs["Interferometric Scale Factor"] = [0.5]
        dataset.attrs["Obliquity Factor"] = [1.0]
        dataset.attrs["Wavelength"] = [_WAVELENGTH_M]
        dataset.attrs["X Converter"] = dataset.attrs["Y Converter"] = lateral
        dataset.attrs["Z Converter"] = height
        attributes = file.create_group("Attributes/{Attributes}").attrs
        attributes["Data Context.Data Attributes.Resolution:Value"] = [surface.pixel_mm / MM_PER_M]


def _place(surface: SurfaceMap) -> dict[str, float]:
    return {"pixel_mm": surface.pixel_mm, "x0_mm": surface.x0_mm, "y0_mm": surface.y0_mm}


_WRITERS: dict[str, Callable[[SurfaceMap, Path], None]] = {
    ".npz": _write_npz,
    ".csv": _write_text,
    ".xyz": _write_text,
    ".h5": _write_hdf5,
    ".datx": _write_datx,
}
