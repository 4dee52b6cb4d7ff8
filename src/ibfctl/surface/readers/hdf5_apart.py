"""HDF5 files (`.h5`, `.datx`, `.mat` of version 7.3) are read by a process of their own.

Damaged ones make the HDF5 library crash, run for ever, or ask for any amount of memory. What happens there stays
there: the child's memory and time are limited, and its end is a refusal like any other.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from ibfctl.errors import InputError
from ibfctl.surface.readers.quantity import Quantity
from ibfctl.surface.readers.table import Table

_CHILD = "ibfctl.surface.readers.hdf5_child"


def read_apart(
    path: Path, quantity: Quantity, pixel_mm: float | None, unit: str | None, array: str | None = None
) -> Table:
    """Read a table of an HDF5 file, laid out as its suffix tells."""
    where = f"{quantity.what} {path}"
    request = {"path": str(path), "stem": quantity.stem, "pixel_mm": pixel_mm, "unit": unit, "array": array}
    with subprocess.Popen(
        [sys.executable, "-m", _CHILD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as child:
        assert child.stdin is not None  # both were made with a pipe
        assert child.stdout is not None
        child.stdin.write(json.dumps(request).encode())
        child.stdin.close()
        answer = json.loads(child.stdout.readline() or b"null")
        if answer is None:
            raise InputError(f"{where}: is damaged, the HDF5 library cannot read it", "copy the file again")
        if "message" in answer:
            raise InputError(answer["message"], answer["hint"])
        values = np.empty(answer["shape"])
        child.stdout.readinto(values.data.cast("B"))  # type: ignore[attr-defined]
    return Table(values, answer["pixel_mm"], answer["x0_mm"], answer["y0_mm"])
