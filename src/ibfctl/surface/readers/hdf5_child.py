"""The process that opens HDF5 files: a request comes in as JSON, a line of JSON and the values go out."""

from __future__ import annotations

import json
import resource
import sys
from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np

from ibfctl.errors import InputError
from ibfctl.surface.readers.datx import read_datx
from ibfctl.surface.readers.hdf5 import read_hdf5
from ibfctl.surface.readers.mat73 import read_mat73
from ibfctl.surface.readers.quantity import HEIGHT, RATE, Quantity
from ibfctl.surface.readers.table import Table

_READERS = {".datx": read_datx, ".mat": read_mat73}
_CPU_S, _BYTES_PER_CPU_S = 5, 4 << 20
_BASE_BYTES = 64 << 20


def main() -> None:
    """Answer one request."""
    request = json.load(sys.stdin)
    path = Path(request.pop("path"))
    quantity = HEIGHT if request.pop("stem") == HEIGHT.stem else RATE
    try:
        cpu_s = _CPU_S + path.stat().st_size // _BYTES_PER_CPU_S
        resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, resource.getrlimit(resource.RLIMIT_CPU)[1]))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        allow_memory(0)
        table = _read(path, quantity, **request)
    except InputError as error:
        _say(message=error.message, hint=error.hint)
        return
    fields = asdict(table)
    values = np.ascontiguousarray(fields.pop("values"))
    _say(shape=values.shape, **fields)
    sys.stdout.buffer.write(values.data)


def allow_memory(size: int) -> None:
    """Limit what is allocated from now on to `size` bytes and what the library itself needs."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = pages * resource.getpagesize() + _BASE_BYTES + size
    resource.setrlimit(resource.RLIMIT_AS, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _read(path: Path, quantity: Quantity, pixel_mm: float | None, unit: str | None, array: str | None) -> Table:
    where = f"{quantity.what} {path}"
    read = _READERS.get(path.suffix.lower(), read_hdf5)
    try:
        with h5py.File(path, "r", locking=False) as file:
            return read(file, quantity, pixel_mm, unit, array, where, allow_memory)
    except InputError:
        raise
    except Exception as error:  # a damaged file makes h5py raise almost anything
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{where}: is no readable HDF5 file ({reason})", "copy the file again") from error


def _say(**fields: object) -> None:
    sys.stdout.buffer.write(json.dumps(fields).encode() + b"\n")
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
