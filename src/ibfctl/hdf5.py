"""HDF5 files that appear whole or not at all, and are sealed where a changed byte could do damage.

The seal is a line after the end of what HDF5 reads: other programs open the file as if it were not there, and lose it
when they change the file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from io import SEEK_END, BytesIO
from pathlib import Path

import h5py

from ibfctl.errors import InputError
from ibfctl.files import atomic_path

_SEAL = b"\nibfctl-sha256:"
_SEAL_BYTES = len(_SEAL) + 2 * hashlib.sha256().digest_size
_BLOCK_BYTES = 1 << 20


@contextmanager
def new_file(path: Path, *, sealed: bool = False) -> Iterator[h5py.File]:
    """Build a file in memory and put it at `path` when the block ends well.

    HDF5 itself may end the whole process when a disk fills up under it; Python's own write raises.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    try:
        with atomic_path(path) as partial:
            image = BytesIO()
            with h5py.File(image, "w") as file:
                yield file
            if sealed:
                image.seek(0, SEEK_END)
                image.write(_SEAL + hashlib.sha256(image.getvalue()).hexdigest().encode())
            partial.write_bytes(image.getbuffer())
    except OSError as error:
        hint = "check the folder, its space and permissions"
        raise InputError(f"{path}: cannot be written ({error})", hint) from error


def check_seal(path: Path) -> None:
    """Refuse a file that is not, byte for byte, what was written with a seal.

    Raises
    ------
    ValueError
        If it has no seal, or another content than was sealed.
    OSError
        If it cannot be read.
    """
    digest = hashlib.sha256()
    left = max(path.stat().st_size - _SEAL_BYTES, 0)
    with path.open("rb") as stream:
        while left and (block := stream.read(min(left, _BLOCK_BYTES))):
            digest.update(block)
            left -= len(block)
        seal = stream.read()
    if not seal.startswith(_SEAL):
        raise ValueError("it has no checksum at its end")
    if seal != _SEAL + digest.hexdigest().encode():
        raise ValueError("its checksum does not fit: it was changed or damaged")
