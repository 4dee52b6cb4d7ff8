"""The journal's writer: motion never waits, and what is recorded is not lost when the journal fails."""

import resource
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ibfctl.runs import recorder
from ibfctl.runs.journal import Journal
from ibfctl.runs.recorder import JournalWriter, absorb


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the journal as another process would that hangs."""
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
    finally:
        connection.execute("ROLLBACK")
        connection.close()


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(recorder, "BUSY_TIMEOUT_S", 0.02)
    monkeypatch.setattr(recorder, "RETRY_S", 0.02)
    path = tmp_path / "journal.db"
    Journal.open(path).close()
    return path


def numbers(path: Path) -> list[int]:
    with Journal.open(path) as journal:
        return [event.data["number"] for event in journal.events(run="r1") if event.kind == "act"]


def until(condition: object) -> None:
    deadline = time.monotonic() + 10
    while not condition() and time.monotonic() < deadline:  # type: ignore[operator]
        time.sleep(0.005)
    assert condition()  # type: ignore[operator]


def test_what_is_recorded_is_on_the_disk_after_a_flush(path: Path, tmp_path: Path) -> None:
    writer = JournalWriter(path, "r1", tmp_path / "side")
    for number in range(100):
        writer.record("act", {"number": number}, key="k1")
    assert writer.flush(10)
    assert numbers(path) == list(range(100))
    writer.record("act", {"number": 100})
    writer.close()
    assert numbers(path) == list(range(101))
    assert not (tmp_path / "side").exists()


def test_a_locked_journal_holds_nobody_up_and_loses_nothing(path: Path, tmp_path: Path) -> None:
    side = tmp_path / "side"
    writer = JournalWriter(path, "r1", side)
    writer.record("act", {"number": 0})
    assert writer.flush(10)
    with locked(path):
        begun = time.monotonic()
        for number in range(1, 50):
            writer.record("act", {"number": number})
        assert time.monotonic() - begun < 0.5
        until(lambda: not writer.ok and side.exists() and side.read_text().count('"act"') == 49)
        assert writer.flush(10)  # in the side file
    until(lambda: writer.ok)
    writer.record("act", {"number": 50})
    writer.close()
    assert numbers(path) == list(range(51))
    assert not side.exists()
    with Journal.open(path) as journal:
        (fault,) = journal.events(run="r1", kind="fault")
    assert "locked" in fault.data["message"]


def test_what_the_journal_never_took_waits_in_the_side_file(path: Path, tmp_path: Path) -> None:
    side = tmp_path / "side"
    with locked(path):
        writer = JournalWriter(path, "r1", side)
        for number in range(5):
            writer.record("act", {"number": number})
        writer.close()
    with side.open("a") as stream:
        stream.write('{"run": "r1", "kind": "act", "da')  # cut off by a crash
    with Journal.open(path) as journal:
        assert absorb(journal, side) == 6  # with the fault
        assert absorb(journal, side) == 0
    assert numbers(path) == list(range(5))


def test_a_side_file_that_came_through_after_all_adds_nothing(path: Path, tmp_path: Path) -> None:
    side = tmp_path / "side"
    with locked(path):
        writer = JournalWriter(path, "r1", side)
        writer.record("act", {"number": 0})
        until(side.exists)
        kept = side.read_text()
    writer.close()
    side.write_text(kept)
    with Journal.open(path) as journal:
        absorb(journal, side)
    assert numbers(path) == [0]


def test_without_any_disk_events_wait_in_memory(path: Path, tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    with locked(path):
        writer = JournalWriter(path, "r1", folder / "side")
        writer.record("act", {"number": 0})
        until(lambda: not writer.ok)
        writer.record("act", {"number": 1})
        assert not writer.flush(0.01)
    writer.close()
    assert numbers(path) == [0, 1]


def test_a_full_disk_holds_nobody_up_and_loses_nothing(path: Path, tmp_path: Path) -> None:
    """No file may grow beyond the journal's present size: the side file fits, the journal does not."""
    side = tmp_path / "side"
    writer = JournalWriter(path, "r1", side)
    for number in range(200):
        writer.record("act", {"number": number, "padding": "x" * 200})
    assert writer.flush(10)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.with_name("journal.db-wal").stat().st_size, hard))
    try:
        for number in range(200, 250):
            writer.record("act", {"number": number})
        until(lambda: not writer.ok and side.exists())
        assert writer.flush(10)  # in the side file
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    until(lambda: writer.ok)
    writer.close()
    assert numbers(path) == list(range(250))
    with Journal.open(path) as journal:
        (fault,) = journal.events(run="r1", kind="fault")
    assert "could not be written" in fault.data["message"]
