"""The journal: what happened in all runs of a data folder, in one SQLite file that only grows.

Every event has the clock on the wall and the monotonic clock of the host; events of a run hold the controller's own
clock in their data. Triggers refuse to change or delete what is written.
"""

from __future__ import annotations

import base64
import json
import sqlite3
import threading
import time
import uuid
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from ibfctl.errors import InputError
from ibfctl.runs.plain import dump

BUSY_TIMEOUT_S = 2.0

MIGRATIONS = (
    """
    CREATE TABLE event (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        token TEXT NOT NULL UNIQUE,
        run TEXT,
        kind TEXT NOT NULL,
        wall TEXT NOT NULL,
        monotonic_s REAL NOT NULL,
        key TEXT,
        data TEXT NOT NULL
    );
    CREATE INDEX event_of_run ON event (run, kind, id);
    CREATE TRIGGER event_is_not_changed BEFORE UPDATE ON event
        BEGIN SELECT RAISE(ABORT, 'the journal only grows'); END;
    CREATE TRIGGER event_is_not_deleted BEFORE DELETE ON event
        BEGIN SELECT RAISE(ABORT, 'the journal only grows'); END;
    CREATE TRIGGER event_is_not_replaced BEFORE INSERT ON event WHEN EXISTS (SELECT 1 FROM event WHERE id = NEW.id)
        BEGIN SELECT RAISE(ABORT, 'the journal only grows'); END;
    """,
)
"""Script by script from an empty file to the present schema; ``user_version`` counts those that were done."""


@dataclass(frozen=True)
class Event:
    """One entry.

    Attributes
    ----------
    run
        The run that it belongs to; None for the service's own.
    kind
        ``state``, ``act``, ``progress``, ``leg``, ``fault``, ``interlock``, ``wire``, ...
    data
        What happened; JSON.
    key
        Id of the key of whoever caused it.
    wall, monotonic_s
        When: ISO 8601 in UTC, and the host's monotonic clock.
    token
        Unlike that of any other event, so that none is ever written twice.
    id
        Place in the journal, ascending; 0 before it is there.
    """

    run: str | None
    kind: str
    data: Mapping[str, Any]
    key: str | None = None
    wall: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="milliseconds"))
    monotonic_s: float = field(default_factory=time.monotonic)
    token: str = field(default_factory=lambda: uuid.uuid4().hex)
    id: int = 0

    def line(self) -> str:
        """Return the event as one line of JSON."""
        return dump(asdict(self))

    @classmethod
    def of_line(cls, line: str) -> Event:
        """Make the event of such a line."""
        return cls(**json.loads(line))


class Journal:
    """An open journal; any thread may use it.

    A call returns when what it wrote is on the disk.
    """

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self._lock = threading.Lock()

    @classmethod
    def open(cls, path: Path, busy_timeout_s: float = BUSY_TIMEOUT_S) -> Journal:
        """Open the journal at `path`, made or brought to the present schema as need be.

        Raises
        ------
        InputError
            If the file cannot be used, or was written by a later version.
        """
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            connection = sqlite3.connect(path, timeout=busy_timeout_s, isolation_level=None, check_same_thread=False)
            try:
                connection.execute("PRAGMA journal_mode = WAL")
                connection.execute("PRAGMA synchronous = FULL")
                _migrate(connection, path)
            except BaseException:
                connection.close()
                raise
        except (sqlite3.Error, OSError) as error:
            raise InputError(f"journal {path}: cannot be used ({error})", "check the folder and its space") from error
        return cls(connection)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._connection.close()

    def append(self, run: str | None, kind: str, data: Mapping[str, Any], key: str | None = None) -> int:
        """Write an event of now; return its id."""
        self.write([Event(run, kind, data, key)])
        return self.last_id()

    def write(self, events: Iterable[Event]) -> None:
        """Write events in one transaction: all or none; those that are there already are left as they are.

        Raises
        ------
        sqlite3.Error
            If the file is locked, full or damaged.
        """
        rows = [(e.token, e.run, e.kind, e.wall, e.monotonic_s, e.key, dump(stored(e))) for e in events]
        with self._lock:
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                self._connection.executemany(
                    "INSERT INTO event (token, run, kind, wall, monotonic_s, key, data) VALUES (?, ?, ?, ?, ?, ?, ?)"
                    " ON CONFLICT (token) DO NOTHING",
                    rows,
                )
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise

    def last_id(self) -> int:
        """Return the id of the last event, 0 where there is none."""
        with self._lock:
            (last,) = self._connection.execute("SELECT coalesce(max(id), 0) FROM event").fetchone()
        return int(last)

    def events(
        self,
        after: int = 0,
        run: str | None = None,
        kind: str | None = None,
        limit: int | None = None,
        without: Sequence[str] = (),
    ) -> list[Event]:
        """Return events in their order.

        Parameters
        ----------
        after
            Only those with a greater id.
        run, kind
            Only those of a run, or of a kind.
        limit
            At most that many.
        without
            None of these kinds.
        """
        conditions, values = ["id > ?"], [after]
        for name, value in (("run", run), ("kind", kind)):
            if value is not None:
                conditions.append(f"{name} = ?")
                values.append(value)  # type: ignore[arg-type]
        for unwanted in without:
            conditions.append("kind != ?")
            values.append(unwanted)  # type: ignore[arg-type]
        question = (
            "SELECT run, kind, data, key, wall, monotonic_s, token, id FROM event"  # noqa: S608 - fixed names
            f" WHERE {' AND '.join(conditions)} ORDER BY id LIMIT ?"
        )
        with self._lock:
            rows = self._connection.execute(question, [*values, -1 if limit is None else limit]).fetchall()
        return [Event(row[0], row[1], json.loads(row[2]), *row[3:]) for row in rows]

    def last(self, run: str, kind: str) -> Event | None:
        """Return the last event of a kind of a run; None where there is none."""
        question = "SELECT coalesce(max(id), 0) FROM event WHERE run = ? AND kind = ?"
        with self._lock:
            (identity,) = self._connection.execute(question, (run, kind)).fetchone()
        return self.events(after=identity - 1, run=run, kind=kind, limit=1)[0] if identity else None

    def wire(self, run: str) -> Iterator[list[Any]]:
        """Return the exchanges with the controller of a run in their order, see `ibfctl.runs.wire`."""
        for event in self.events(run=run, kind="wire"):
            yield from unpacked(event.data)


def stored(event: Event) -> Mapping[str, Any]:
    """Return the data of an event as they are stored: exchanges with the controller are many and nearly the same."""
    if event.kind != "wire":
        return event.data
    text = base64.b64encode(zlib.compress(dump(event.data["exchanges"]).encode())).decode("ascii")
    return {"count": len(event.data["exchanges"]), "zlib": text}


def unpacked(data: Mapping[str, Any]) -> list[list[Any]]:
    """Return the exchanges of the stored data of a ``wire`` event."""
    exchanges: list[list[Any]] = json.loads(zlib.decompress(base64.b64decode(data["zlib"])))
    return exchanges


def _migrate(connection: sqlite3.Connection, path: Path) -> None:
    version = _version(connection)
    if version > len(MIGRATIONS):
        raise InputError(
            f"journal {path}: has schema {version}, this version knows up to {len(MIGRATIONS)}",
            "use the version that wrote it, or a later one",
        )
    if version == len(MIGRATIONS):
        return
    connection.execute("BEGIN IMMEDIATE")
    try:
        version = _version(connection)  # somebody else may have been faster
        for script in MIGRATIONS[version:]:
            for statement in _statements(script):
                connection.execute(statement)
        connection.execute(f"PRAGMA user_version = {len(MIGRATIONS)}")
        connection.execute("COMMIT")
    except BaseException:
        connection.execute("ROLLBACK")
        raise


def _version(connection: sqlite3.Connection) -> int:
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def _statements(script: str) -> Iterator[str]:
    """Split a script; sqlite3's own `executescript` would commit in between."""
    statement = ""
    for part in script.split(";")[:-1]:
        statement += f"{part};"
        if sqlite3.complete_statement(statement):
            yield statement
            statement = ""
