import os
import signal
import sqlite3
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from ibfctl.errors import InputError
from ibfctl.runs.journal import MIGRATIONS, Event, Journal

WRITE_FOREVER = """
import sys
from pathlib import Path
from ibfctl.runs.journal import Journal
journal = Journal.open(Path(sys.argv[1]))
number = 0
while True:
    journal.append(sys.argv[2], "state", {"number": number})
    print(number, flush=True)
    number += 1
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "data" / "journal.db"


def test_events_come_back_in_order_with_both_clocks_and_the_key(path: Path) -> None:
    with Journal.open(path) as journal:
        first = journal.append("r1", "state", {"state": "running"})
        second = journal.append("r2", "act", {"act": "pause"}, key="k7")
        journal.append(None, "service", {"started": True})
        assert first < second
        assert [event.kind for event in journal.events()] == ["state", "act", "service"]
        (act,) = journal.events(run="r2")
        assert (act.key, act.data, act.id) == ("k7", {"act": "pause"}, second)
        assert act.wall.endswith("+00:00")
        assert act.monotonic_s > 0
        assert [event.id for event in journal.events(after=first, limit=1)] == [second]
        assert journal.last_id() == second + 1


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE event SET data = '{}'",
        "DELETE FROM event",
        "INSERT OR REPLACE INTO event SELECT id, 'other', run, kind, wall, monotonic_s, key, '{}' FROM event",
    ],
)
def test_what_is_written_stays_as_it_is(path: Path, statement: str) -> None:
    with Journal.open(path) as journal:
        journal.append("r1", "state", {"state": "running"})
    connection = sqlite3.connect(path)
    with pytest.raises(sqlite3.IntegrityError, match="only grows"):
        connection.execute(statement)
    connection.close()
    with Journal.open(path) as journal:
        assert [event.data for event in journal.events()] == [{"state": "running"}]


def test_an_event_is_never_written_twice(path: Path) -> None:
    event = Event("r1", "act", {"act": "stop"})
    with Journal.open(path) as journal:
        journal.write([event])
        journal.write([event, Event("r1", "act", {"act": "abort"})])
        assert [found.data["act"] for found in journal.events()] == ["stop", "abort"]


def test_a_batch_is_written_whole_or_not_at_all(path: Path) -> None:
    with Journal.open(path) as journal:
        with pytest.raises(sqlite3.IntegrityError):
            journal.write([Event("r1", "act", {}), Event("r1", None, {})])  # type: ignore[arg-type]
        assert journal.events() == []
        journal.append("r1", "act", {})


def test_exchanges_with_the_controller_are_packed(path: Path) -> None:
    exchanges = [["status", "MG _BTA,_BTB", f" {n}.0000 {n}.0000", 0.05 * n] for n in range(200)]
    with Journal.open(path) as journal:
        journal.append("r1", "wire", {"exchanges": exchanges})
        journal.append("r1", "wire", {"exchanges": exchanges[:1]})
        assert list(journal.wire("r1")) == [*exchanges, exchanges[0]]
        event = journal.events(run="r1")[0]
    assert event.data["count"] == 200
    assert len(event.data["zlib"]) < len(str(exchanges)) / 4


def test_several_processes_and_threads_write_one_journal(path: Path) -> None:
    with Journal.open(path) as one, Journal.open(path) as other:
        threads = [
            threading.Thread(target=lambda j=journal, n=name: [j.append(n, "act", {}) for _ in range(20)])
            for name, journal in (("r1", one), ("r2", one), ("r3", other))
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert [len(one.events(run=name)) for name in ("r1", "r2", "r3")] == [20, 20, 20]


def test_a_journal_of_an_older_schema_is_brought_up_and_a_newer_one_refused(path: Path) -> None:
    path.parent.mkdir()
    sqlite3.connect(path).close()  # version 0: empty
    with Journal.open(path) as journal:
        journal.append(None, "service", {})
    connection = sqlite3.connect(path)
    assert connection.execute("PRAGMA user_version").fetchone() == (len(MIGRATIONS),)
    assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    connection.execute(f"PRAGMA user_version = {len(MIGRATIONS) + 1}")
    connection.close()
    with pytest.raises(InputError, match="use the version that wrote it"):
        Journal.open(path)


def test_what_is_no_journal_is_refused(path: Path) -> None:
    path.parent.mkdir()
    path.write_text("this is a text of some length and no database at all" * 20)
    with pytest.raises(InputError, match="cannot be used"):
        Journal.open(path)


def test_no_committed_event_is_lost_by_kill_9(path: Path) -> None:
    for number in range(4):
        run = f"r{number}"
        command = [sys.executable, "-c", WRITE_FOREVER, str(path), run]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
            assert writer.stdout is not None
            for _ in range(15 + 7 * number):
                writer.stdout.readline()
            os.kill(writer.pid, signal.SIGKILL)
            committed = 15 + 7 * number + len(writer.stdout.read().splitlines())
        with Journal.open(path) as journal:
            written = [event.data["number"] for event in journal.events(run=run)]
        assert len(written) >= committed
        assert written == list(range(len(written)))
