"""What a worker says of its run about ten times a second: one small file that is always whole."""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ibfctl.files import atomic_path
from ibfctl.runs.places import STATUS
from ibfctl.runs.plain import dump

INTERVAL_S = 0.1


def read(folder: Path) -> dict[str, Any] | None:
    """Return the last status of the run in `folder`; None where there is none yet."""
    try:
        status: dict[str, Any] = json.loads((folder / STATUS).read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None
    return status


def write(folder: Path, status: Mapping[str, Any]) -> None:
    """Put a status in place of the last one."""
    with atomic_path(folder / STATUS) as partial:
        partial.write_text(dump(status), encoding="utf-8")


def amend(folder: Path, **fields: Any) -> None:
    """Change fields of the status that a worker has left, which no longer lives."""
    left = read(folder) or {"run": folder.name, "seq": 0}
    write(folder, {**left, **fields, "seq": left["seq"] + 1, "at": _now()})


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


class StatusWriter:
    """Writes the status of a run from a thread of its own: whoever tells it something never waits for a disk.

    Parameters
    ----------
    folder
        Folder of the run.
    always
        Fields that do not change.
    first_seq
        Number of the first status; a later worker of the same run goes on counting.
    """

    def __init__(self, folder: Path, always: Mapping[str, Any], first_seq: int = 0) -> None:
        self._folder = folder
        self._status: dict[str, Any] = dict(always)
        self._seq = first_seq
        self._lock = threading.Lock()
        self._changed = threading.Event()
        self._finished = threading.Event()
        self._thread = threading.Thread(target=self._work, name="run-status", daemon=True)
        self._thread.start()

    def tell(self, **fields: Any) -> None:
        """Change fields; the file follows within a tenth of a second."""
        with self._lock:
            self._status.update(fields)
        self._changed.set()

    def close(self) -> None:
        """Write what was told last."""
        self._finished.set()
        self._changed.set()
        self._thread.join()

    def _work(self) -> None:
        while not self._finished.is_set():
            self._changed.wait()
            self._changed.clear()
            self._write()
            self._finished.wait(INTERVAL_S)
        self._write()

    def _write(self) -> None:
        with self._lock:
            self._seq += 1
            status = {**self._status, "seq": self._seq, "at": _now()}
        try:
            write(self._folder, status)
        except OSError:  # the run goes on; an old status shows its age
            self._changed.set()
