"""Zygo Mx files (`.datx`): HDF5 with the surface, its unit, and where the factors to metres stand.

The layout is not published; these facts are common to the public readers of it (prysm, SurfaceTopography). The surface
is `/Measurement/Surface` or the only dataset in `/Data/Surface`. Its attributes say `Unit` (a length, or `Fringes` with
`Interferometric Scale Factor`, `Obliquity Factor` and `Wavelength` in metres), `No Data`, and `X Converter` and
`Y Converter`, whose last member holds the metres of a pixel at its second place. The top row of the camera's picture
comes first.
"""

from __future__ import annotations

import h5py
import numpy as np

from ibfctl.errors import InputError
from ibfctl.surface.readers.hdf5 import Allow, attribute, dataset_of, names_in, number, read_values
from ibfctl.surface.readers.quantity import Quantity
from ibfctl.surface.readers.table import Table, square_pitch
from ibfctl.units import MM_PER_M

_SURFACE, _SURFACES = "Measurement/Surface", "Data/Surface"
_UNITS = {
    "NanoMeters": "nm", "MicroMeters": "um", "MilliMeters": "mm", "Meters": "m", "PicoMeters": "pm",
}  # fmt: skip
_FRINGES = "Fringes"
_FACTORS = ("Interferometric Scale Factor", "Obliquity Factor", "Wavelength")


def read_datx(
    file: h5py.File,
    quantity: Quantity,
    pixel_mm: float | None,
    unit: str | None,
    array: str | None,
    where: str,
    allow: Allow,
) -> Table:
    """Read the surface; the rows are turned over, so that y grows upwards in the camera's picture."""
    quantity.refuse_heights(where)
    dataset = dataset_of(file, array or _surface(file, where), where)
    scale = _scale(dataset, quantity, unit, where)
    pixel_mm = quantity.pixel_mm(_pixel_mm(dataset, where), pixel_mm, where)
    values = read_values(dataset, where, allow)
    if "No Data" in dataset.attrs:
        values = np.where(values >= number(dataset, "No Data", where), np.nan, values)
    return Table(values[::-1] * scale, pixel_mm)


def _surface(file: h5py.File, where: str) -> str:
    if _SURFACE in file:
        return _SURFACE
    group = file.get(_SURFACES)
    held = names_in(group) if isinstance(group, h5py.Group) else []
    if len(held) != 1:
        raise InputError(
            f"{where}: holds {len(held)} surfaces ({', '.join(held[:9]) or 'none'})", f"name one: {_SURFACES}/NAME"
        )
    return f"{_SURFACES}/{held[0]}"


def _scale(dataset: h5py.Dataset, quantity: Quantity, unit: str | None, where: str) -> float:
    declared = attribute(dataset, "Unit", where)
    if declared == _FRINGES:
        metres = float(np.prod([number(dataset, name, where) for name in _FACTORS]))
        if not 0 < metres < 1:
            raise InputError(f"{where}: a fringe is {metres:g} m by its factors", "save it anew in Mx")
        return metres * quantity.scale("m", unit, where)
    return quantity.scale(_UNITS.get(declared, declared), unit, where)


def _pixel_mm(dataset: h5py.Dataset, where: str) -> float | None:
    """Return the pixel size; None where the camera is not calibrated."""
    pitch_mm = []
    for name in ("X Converter", "Y Converter"):
        converter = attribute(dataset, name, where)
        try:
            pitch_mm.append(0.0 if converter is None else float(converter[-1][1]) * MM_PER_M)
        except (TypeError, ValueError, IndexError, KeyError) as error:
            raise InputError(f"{where}: its {name} cannot be read", "save it anew in Mx") from error
    return square_pitch(pitch_mm[0], pitch_mm[1], where) if any(pitch_mm) else None
