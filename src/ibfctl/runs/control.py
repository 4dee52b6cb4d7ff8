"""The way to a running worker: a named pipe that takes one line of JSON for every act."""

from __future__ import annotations

import errno
import json
import os
import select
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ibfctl.errors import RunError
from ibfctl.runs.places import CONTROL

URGENT = ("abort", "estop")
"""Acts that wait for nobody, and that nobody is kept from."""
_MODE = 0o600
Act = Mapping[str, Any]


def send(folder: Path, act: Act) -> None:
    """Hand an act to the worker of the run in `folder`, e.g. ``{"act": "pause", "when": "now", "key": ".."}``.

    Raises
    ------
    RunError
        If no worker lives, or it no longer listens.
    """
    line = f"{json.dumps(act)}\n".encode()
    if len(line) > select.PIPE_BUF:  # longer ones may be torn apart by those of somebody else
        raise RunError(f"an act of {len(line)} bytes is too long", f"at most {select.PIPE_BUF} bytes fit")
    try:
        descriptor = os.open(folder / CONTROL, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        if error.errno not in (errno.ENXIO, errno.ENOENT):
            raise
        raise RunError(
            f"run {folder.name} has no worker", "it is over, or was interrupted: look at its state"
        ) from error
    try:
        os.write(descriptor, line)
    except (BlockingIOError, BrokenPipeError) as error:
        raise RunError(f"the worker of run {folder.name} does not listen", "use the emergency stop") from error
    finally:
        os.close(descriptor)


def open_pipe(folder: Path) -> int:
    """Make the pipe if need be and return a descriptor of it; acts wait in it as long as one is open."""
    path = folder / CONTROL
    if not path.exists():
        os.mkfifo(path, _MODE)
    # Both ways: a pipe whose last writer has gone would otherwise read as ended.
    return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)


class ControlReader:
    """Passes acts on from a thread of its own.

    Parameters
    ----------
    descriptor
        Of `open_pipe`; it is closed by `close`.
    on_act
        Called with every act, in the reader's thread.
    on_refused
        Called with what cannot be understood.
    """

    def __init__(self, descriptor: int, on_act: Callable[[Act], None], on_refused: Callable[[str], None]) -> None:
        self._descriptor = descriptor
        self._on_act = on_act
        self._on_refused = on_refused
        self._wake, self._end = os.pipe()
        self._thread = threading.Thread(target=self._work, name="run-control", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and close the pipe: from now on there is no worker for `send`."""
        os.close(self._end)
        self._thread.join()
        os.close(self._wake)
        os.close(self._descriptor)

    def _work(self) -> None:
        received = b""
        while True:
            ready, _, _ = select.select([self._descriptor, self._wake], [], [])
            if self._descriptor in ready:
                *lines, received = (received + os.read(self._descriptor, select.PIPE_BUF)).split(b"\n")
                for line in lines:
                    self._pass_on(line)
            elif self._wake in ready:
                return

    def _pass_on(self, line: bytes) -> None:
        try:
            act = json.loads(line)
            if not isinstance(act, dict) or not isinstance(act.get("act"), str):
                raise ValueError("no act")
        except ValueError:
            self._on_refused(line.decode("utf-8", "replace"))
        else:
            self._on_act(act)
