"""HDF5 files that appear whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import h5py

from ibfctl.errors import InputError
from ibfctl.files import atomic_path


@contextmanager
def new_file(path: Path) -> Iterator[h5py.File]:
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
            partial.write_bytes(image.getbuffer())
    except OSError as error:
        hint = "check the folder, its space and permissions"
        raise InputError(f"{path}: cannot be written ({error})", hint) from error
