"""Files that are there completely or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ibfctl.errors import InputError


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a path beside `path` to write to; it takes the place of `path` when the block ends well.

    Raises
    ------
    InputError
        If there is something else than a file at `path`: a device would be replaced, not written to.
    """
    check_replaceable(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def check_replaceable(path: Path) -> None:
    """Refuse a path at which something else than a file is: a folder, a device, a pipe."""
    if path.exists() and not path.is_file():
        raise InputError(f"output {path}: is no file but a folder or a device", "give the name of a file")


def state_folder() -> Path:
    """Return the product's folder in the user's state directory; it may not exist yet."""
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(state) / "ibfctl"


def save_npz(path: Path, **arrays: Any) -> None:
    """Write named arrays to a compressed NumPy archive, completely or not at all."""
    import numpy as np  # the command line imports this module and loads nothing numerical

    with atomic_path(path) as partial, partial.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
