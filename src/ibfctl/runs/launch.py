"""Start the worker of a run, so that it lives on whatever becomes of whoever started it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from ibfctl.errors import RunError
from ibfctl.runs.control import open_pipe
from ibfctl.runs.lock import take
from ibfctl.runs.places import LOCK, LOG

WORKER = "ibfctl.runs.worker"


def start_worker(folder: Path) -> subprocess.Popen[bytes]:
    """Start the worker of the run in `folder` (of `ibfctl.runs.job.prepare`) in a session of its own.

    The worker inherits the lock that says that it lives, and the pipe for acts: from here on acts reach it, even
    before it has looked at the first one.

    Returns
    -------
    Popen
        To be waited for by whoever stays its parent; the exit code is that of the run's error, or 0.

    Raises
    ------
    RunError
        If the run has a worker already.
    """
    lock = take(folder / LOCK, f"worker started by process {os.getpid()}")
    if lock is None:
        raise RunError(f"run {folder.name} has a worker already", "talk to that one")
    try:
        control = open_pipe(folder)
        try:
            with (folder / LOG).open("ab") as log:
                return subprocess.Popen(
                    [sys.executable, "-m", WORKER, str(folder.absolute()), str(lock), str(control)],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    pass_fds=(lock, control),
                    start_new_session=True,
                )
        finally:
            os.close(control)
    finally:
        os.close(lock)


def let_go(process: subprocess.Popen[bytes]) -> None:
    """Forget a child that is to outlive its parent, which would otherwise be warned that it still runs."""
    if process.poll() is None:
        process.returncode = 0
