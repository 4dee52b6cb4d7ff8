"""Maps that lie in the product's own files: what a plan predicts, and what a run has left."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import h5py

from ibfctl.errors import InputError
from ibfctl.hdf5 import check_seal
from ibfctl.surface.map import SurfaceMap
from ibfctl.surface.readers import read_map

Quantity = Literal["residual", "removal"]

_GROUPS = {"plan": "prediction", "run": "as_run"}


def written_map(path: Path, quantity: Quantity) -> SurfaceMap:
    """Read the residual or the removal of a plan file (predicted) or of a run file (as run).

    Raises
    ------
    InputError
        If the file is neither, is not as it was written, or holds no map.
    """
    try:
        check_seal(path)
        with h5py.File(path) as file:
            kind = str(file.attrs.get("format")).partition("/")[0].rpartition("-")[2]
            group = _GROUPS.get(kind, "")
            held = group in file
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error})", "give a plan.h5 or run.h5") from error
    if not held:
        raise InputError(f"{path}: holds no map", "give the plan.h5 of `ibfctl plan`, or the run.h5 of such a plan")
    return read_map(path, array=f"{group}/{quantity}_nm")
