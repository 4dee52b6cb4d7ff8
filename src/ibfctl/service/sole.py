"""One service on a data folder: two would answer for each other's plans and runs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ibfctl.errors import InputError
from ibfctl.runs.lock import owner_of, take
from ibfctl.runs.places import SERVICE_LOCK


@contextmanager
def sole_service(data: Path) -> Iterator[None]:
    """Hold a data folder for this process; whatever it dies of, the folder is free again.

    Raises
    ------
    InputError
        If another service holds it.
    """
    path = data / SERVICE_LOCK
    descriptor = take(path, f"process {os.getpid()}")
    if descriptor is None:
        raise InputError(
            f"serve: data folder {data} is in use by another service ({owner_of(path) or 'unknown process'})",
            "end that one first, or give another --data",
        )
    try:
        yield
    finally:
        os.close(descriptor)
