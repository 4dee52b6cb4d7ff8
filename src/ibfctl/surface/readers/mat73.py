"""MATLAB version 7.3 files: HDF5 with one dataset per variable, its dimensions in reverse order."""

from __future__ import annotations

import h5py

from ibfctl.surface.readers.hdf5 import Allow, FloatArray, dataset_of, names_in, read_values
from ibfctl.surface.readers.mat import arranged
from ibfctl.surface.readers.quantity import Quantity
from ibfctl.surface.readers.table import Table


def read_mat73(
    file: h5py.File,
    quantity: Quantity,
    pixel_mm: float | None,
    unit: str | None,
    array: str | None,
    where: str,
    allow: Allow,
) -> Table:
    """Read one array, chosen and scaled as of a file of version 5."""

    def fetch(name: str) -> FloatArray:
        return read_values(dataset_of(file, name, where), f"{where}: {name}", allow).T

    variables = [name for name in names_in(file) if not name.startswith("#")]  # MATLAB's own
    return arranged(variables, fetch, quantity, pixel_mm, unit, array, where)
