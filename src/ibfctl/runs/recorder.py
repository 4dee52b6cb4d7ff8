"""The journal's writer beside a run: whoever records never waits for a disk, and nothing recorded is lost."""

from __future__ import annotations

import logging
import os
import queue
import sqlite3
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ibfctl.errors import InputError
from ibfctl.runs.journal import BUSY_TIMEOUT_S, Event, Journal

RETRY_S = 0.5
GATHER_S = 0.02

_log = logging.getLogger(__name__)


class JournalWriter:
    """Writes events of one run, or of the service, to the journal from a thread of its own.

    While the journal is locked, full or broken, events wait in memory and in a side file; they are written in their
    order as soon as the journal takes them again, or by `absorb` when the next one opens the run's folder.

    Parameters
    ----------
    path
        The journal.
    run
        Id of the run; None for what the service does.
    side
        The side file; it is there only while the journal fails.
    """

    def __init__(self, path: Path, run: str | None, side: Path) -> None:
        self._path = path
        self._run = run
        self._side = side
        self._events: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
        self._recorded = self._settled = 0
        self._settling = threading.Condition()
        self._pending: list[Event] = []
        self._aside = self._aside_bytes = 0
        self._journal: Journal | None = None
        self._thread = threading.Thread(target=self._work, name="run-journal", daemon=True)
        self.ok = True
        self._thread.start()

    def record(self, kind: str, data: Mapping[str, Any], key: str | None = None) -> None:
        """Take an event of now; never waits and never raises."""
        with self._settling:
            self._recorded += 1
        self._events.put(Event(self._run, kind, data, key))

    def flush(self, timeout_s: float) -> bool:
        """Wait until all that was recorded is on the disk, if only in the side file; return whether it is."""
        with self._settling:
            wanted = self._recorded
            return self._settling.wait_for(lambda: self._settled + self._aside >= wanted, timeout_s)

    def close(self) -> None:
        """Write what is left, to the side file if need be."""
        self._events.put(None)
        self._thread.join()

    def _work(self) -> None:
        finished = False
        while not finished:
            finished = self._gather()
            self._write()
        if self._journal is not None:
            self._journal.close()

    def _gather(self) -> bool:
        """Take what waits, and what comes within a moment; return whether that was the last."""
        try:
            event = self._events.get(timeout=RETRY_S if self._pending else None)
            time.sleep(GATHER_S if event is not None and self._events.empty() else 0.0)
            while event is not None:
                self._pending.append(event)
                event = self._events.get_nowait()
        except queue.Empty:
            return False
        return True

    def _write(self) -> None:
        if not self._pending:
            return
        try:
            if self._journal is None:
                self._journal = Journal.open(self._path, BUSY_TIMEOUT_S)
            self._journal.write(self._pending)
        except (sqlite3.Error, InputError, OSError) as error:
            self._fail(error)
            return
        if self._aside:
            self._side.unlink(missing_ok=True)
        with self._settling:
            self._settled += len(self._pending)
            self._aside = self._aside_bytes = 0
            self._settling.notify_all()
        self._pending.clear()
        self.ok = True

    def _fail(self, error: Exception) -> None:
        if self._journal is not None:
            self._journal.close()
            self._journal = None
        if self.ok:
            _log.error("the journal cannot be written (%s); events wait", error)
            told = {"code": "journal", "message": f"the journal could not be written: {error}"}
            self._pending.append(Event(self._run, "fault", told))
            with self._settling:
                self._recorded += 1
        self.ok = False
        self._put_aside()

    def _put_aside(self) -> None:
        """Keep in the side file what the journal did not take, in case that this process ends before it does."""
        lines = "".join(f"{event.line()}\n" for event in self._pending[self._aside :]).encode()
        try:
            with self._side.open("ab") as stream:
                stream.truncate(self._aside_bytes)  # an earlier attempt may have come half way
                stream.write(lines)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            _log.error("nor can the side file be written (%s); events wait in memory", error)
        else:
            with self._settling:
                self._aside = len(self._pending)
                self._aside_bytes += len(lines)
                self._settling.notify_all()


def absorb(journal: Journal, side: Path) -> int:
    """Write what a side file holds to the journal and remove it; return how many events it held.

    An event that had come through after all is not written twice.
    """
    try:
        lines = side.read_text(encoding="utf-8").splitlines(keepends=True)
    except FileNotFoundError:
        return 0
    events = [Event.of_line(line) for line in lines if line.endswith("\n")]  # the last may have been cut off
    journal.write(events)
    side.unlink()
    return len(events)
