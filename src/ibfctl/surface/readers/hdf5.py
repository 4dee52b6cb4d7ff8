"""HDF5 files (`.h5`, `.hdf5`) as this product writes them: `height_nm` or `rate_nm_s` with `pixel_mm` beside it.

The unit is the dataset's attribute `unit`, or ends its name; `pixel_mm`, `x0_mm` and `y0_mm` are attributes of the
dataset, of its group, or of the file. Without a name, the table of a plan or run file is taken.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.surface.readers.quantity import Quantity
from ibfctl.surface.readers.table import Table, check_size

FloatArray = NDArray[np.float64]
Allow = Callable[[int], None]

_IN_A_PLAN = {"height": "map/height_nm", "rate": "influence/rate_nm_s"}
_MAX_NAMES = 1000
_MAX_ATTRIBUTE_BYTES = 1 << 16
_ITEM_BYTES = 8


def read_hdf5(
    file: h5py.File,
    quantity: Quantity,
    pixel_mm: float | None,
    unit: str | None,
    array: str | None,
    where: str,
    allow: Allow,
) -> Table:
    """Read a table and where it lies."""
    name = array or _found(file, quantity, where)
    dataset = dataset_of(file, name, where)
    scale = quantity.scale(_unit(dataset, quantity, where), unit, where)
    place: dict[str, float] = {}
    for holder in (dataset, dataset.parent, file):
        given = {key: number(holder, key, where) for key in ("pixel_mm", "x0_mm", "y0_mm") if key in holder.attrs}
        place = given if "pixel_mm" in given and not place else place
    if ("x0_mm" in place) != ("y0_mm" in place):
        raise InputError(f"{where}: holds only one of x0_mm and y0_mm", "give both or neither")
    pixel_mm = quantity.pixel_mm(place.get("pixel_mm"), pixel_mm, where)
    values = read_values(dataset, f"{where}: {name}", allow)
    return Table(values * scale, pixel_mm, place.get("x0_mm"), place.get("y0_mm"))


def dataset_of(file: h5py.File, name: str, where: str) -> h5py.Dataset:
    """Return a dataset that lies in this file itself, with all its values.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    found = file.get(name)
    if not isinstance(found, h5py.Dataset):
        raise InputError(f"{where}: has no array {name}, it holds {_listed(file)}", "name the array to read")
    if found.file.filename != file.filename or found.is_virtual or found.external:
        raise InputError(f"{where}: {name} lies in another file", "store the values in one file")
    return found


def names_in(group: h5py.Group) -> list[str]:
    """Return the names in a group; of a group with more than any map file has, the first."""
    return list(itertools.islice(group, _MAX_NAMES))


def read_values(dataset: h5py.Dataset, where: str, allow: Allow) -> FloatArray:
    """Read a table of real numbers; memory for four times its size, and no more, is allowed before."""
    check_size(dataset.shape, where)
    if dataset.dtype.kind not in "fiu" or dataset.dtype.itemsize > _ITEM_BYTES:
        raise InputError(f"{where}: holds {dataset.dtype} where real numbers are needed", "store it as float64")
    allow(4 * _ITEM_BYTES * dataset.size)
    return np.asarray(dataset[()], dtype=np.float64)


def attribute(holder: h5py.HLObject, name: str, where: str) -> Any:
    """Return the first or only value of an attribute; text as a string, None where there is none."""
    if name not in holder.attrs:
        return None
    if holder.attrs.get_id(name).get_storage_size() > _MAX_ATTRIBUTE_BYTES:
        raise InputError(f"{where}: its attribute {name} is too large", "save it anew")
    value = np.asarray(holder.attrs[name]).reshape(-1)
    if value.size == 0:
        return None
    first = value[0]
    return first.decode("utf-8", "replace") if isinstance(first, bytes) else first


def number(holder: h5py.HLObject, name: str, where: str) -> float:
    """Return an attribute that must be one finite number."""
    try:
        value = float(attribute(holder, name, where))
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: its {name} is no number", "correct the file") from error
    if not np.isfinite(value):
        raise InputError(f"{where}: its {name} is {value}, it must be a finite number", "correct the file")
    return value


def _found(file: h5py.File, quantity: Quantity, where: str) -> str:
    tables = [name for name in names_in(file) if quantity.split(name)[0] == quantity.stem]
    if len(tables) == 1:
        return tables[0]
    if not tables and isinstance(file.get(_IN_A_PLAN[quantity.stem]), h5py.Dataset):
        return _IN_A_PLAN[quantity.stem]
    raise InputError(
        f"{where}: needs exactly one array named like {quantity.example}, it holds {_listed(file)}",
        "store one table, with its unit in its name, or name the array to read",
    )


def _listed(file: h5py.File) -> str:
    return ", ".join(names_in(file)[:20]) or "nothing"


def _unit(dataset: h5py.Dataset, quantity: Quantity, where: str) -> str | None:
    declared = attribute(dataset, "unit", where)
    if declared is not None:
        return str(declared)
    leaf = str(dataset.name).rpartition("/")[2]
    _, unit = quantity.split(leaf)
    ending = leaf.rpartition("_")[2]
    return ending if unit not in quantity.units and ending in quantity.units else unit
