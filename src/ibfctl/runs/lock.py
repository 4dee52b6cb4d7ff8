"""Locks that end with their holder: the kernel frees them, whatever the holder dies of."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import socket
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from ibfctl.errors import RunError
from ibfctl.files import state_folder
from ibfctl.machine.description import Connection, MachineDescription

_LONGEST_OWNER = 512
_TRIES, _TRY_S = 5, 0.01


def take(path: Path, owner: str) -> int | None:
    """Lock a file for whoever holds the descriptor that is returned, or inherits it; None if it is taken.

    The file stays when the lock ends: to remove it would let two hold a lock of the same name.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    for _ in range(_TRIES):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:  # perhaps somebody only looks
            time.sleep(_TRY_S)
        else:
            with contextlib.suppress(OSError):  # a full disk is no reason not to hold it
                os.ftruncate(descriptor, 0)
                os.pwrite(descriptor, owner.encode()[:_LONGEST_OWNER], 0)
            return descriptor
    os.close(descriptor)
    return None


def is_held(path: Path) -> bool:
    """Return whether anybody holds the lock of a file."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    try:
        # Shared, so that two who ask at once do not take each other for the holder.
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def owner_of(path: Path) -> str:
    """Return what the last holder of a lock said of itself."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


class MachineLock:
    """The right to move a machine: held by one run or one act at a time, in all data folders of a user.

    Parameters
    ----------
    machine
        Its connection names the lock.
    owner
        Who asks, in the words that a second one is shown, e.g. ``run 0123``.

    Raises
    ------
    RunError
        On entering, if somebody else holds it.
    """

    def __init__(self, machine: MachineDescription, owner: str) -> None:
        self._machine = machine
        self._owner = f"{owner} (process {os.getpid()})"
        self.path = lock_path(machine.connection)
        self._descriptor = -1

    def __enter__(self) -> Self:
        descriptor = take(self.path, self._owner)
        if descriptor is None:
            raise RunError(
                f"machine {self._machine.name!r} is in use by {owner_of(self.path) or 'another process'}",
                "wait for its end, or stop it",
            )
        self._descriptor = descriptor
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._descriptor)


def lock_path(connection: Connection) -> Path:
    """Return the lock of the controller behind a connection: the same for every name of its host."""
    if connection.serial is not None:
        place = os.path.realpath(connection.serial)
    else:
        try:
            place = f"{socket.gethostbyname(connection.host)}-{connection.port}"
        except OSError:  # it will not be reached either, and says so better
            place = f"{connection.host}-{connection.port}"
    name = re.sub(r"[^A-Za-z0-9.-]", "_", f"{connection.driver}-{place}")
    return state_folder() / "locks" / f"{name}.lock"
