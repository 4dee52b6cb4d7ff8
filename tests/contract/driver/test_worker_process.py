"""The worker of a run as a process: it needs nobody, hears acts, and leaves a record whatever it dies of."""

from __future__ import annotations

import os
import signal
import socket
import sqlite3
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import pytest
from support.jobs import small_run
from support.proxy import Proxy

from ibfctl.errors import RunError
from ibfctl.runs import control, status
from ibfctl.runs.adoption import has_worker, interrupt_orphans
from ibfctl.runs.detached_emulator import DetachedEmulator
from ibfctl.runs.history import history
from ibfctl.runs.job import Address, read_job, write_job
from ibfctl.runs.journal import Journal
from ibfctl.runs.launch import start_worker
from ibfctl.runs.lock import MachineLock
from ibfctl.runs.places import journal_path
from ibfctl.runs.transcript import transcript

PATIENCE_S = 30.0
SPEED = 50.0


@pytest.fixture(scope="module")
def emulator(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DetachedEmulator]:
    started = DetachedEmulator.start_or_adopt(tmp_path_factory.mktemp("emulator"), speed=SPEED)
    yield started
    started.end()


@pytest.fixture
def folder(tmp_path: Path, emulator: DetachedEmulator) -> Path:
    return small_run(tmp_path, emulator.controller.port, SPEED)


@pytest.fixture
def worker(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    process = start_worker(folder)
    yield process
    process.kill()
    process.wait()


def until_status(folder: Path, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        shown = status.read(folder)
        if shown is not None and condition(shown):
            return shown
        time.sleep(0.005)
    pytest.fail(f"status is still {shown}; {(folder / 'worker.log').read_text()}")


def states(folder: Path) -> list[str]:
    with Journal.open(journal_path(folder.parent.parent)) as journal:
        return [event.data["state"] for event in journal.events(run="r1", kind="state")]


def test_a_run_needs_nobody_and_is_recorded(folder: Path, worker: subprocess.Popen[bytes]) -> None:
    assert has_worker(folder)
    with pytest.raises(RunError, match="has a worker already"):
        start_worker(folder)
    assert os.getsid(worker.pid) == worker.pid
    assert worker.wait(PATIENCE_S) == 0, (folder / "worker.log").read_text()
    assert not has_worker(folder)
    assert states(folder) == ["queued", "preflight", "moving_to_start", "armed", "running", "finishing", "completed"]
    shown = status.read(folder)
    assert shown is not None
    assert (shown["run"], shown["state"], shown["executed"], shown["gate"]) == ("r1", "completed", 900, "closed")
    assert shown["journal_ok"] is True


def test_an_act_sent_before_the_worker_looks_is_not_lost(folder: Path, worker: subprocess.Popen[bytes]) -> None:
    control.send(folder, {"act": "abort", "key": "k2"})
    assert worker.wait(PATIENCE_S) == 7
    assert states(folder)[-1] == "aborted"
    with Journal.open(journal_path(folder.parent.parent)) as journal:
        (act,) = journal.events(run="r1", kind="act")
    assert (act.key, act.data["act"]) == ("k2", "abort")
    with pytest.raises(RunError, match="has no worker"):
        control.send(folder, {"act": "abort"})


def test_sigterm_aborts(folder: Path, worker: subprocess.Popen[bytes]) -> None:
    until_status(folder, lambda shown: shown.get("executed", 0) > 20)
    worker.terminate()
    assert worker.wait(PATIENCE_S) == 7
    shown = until_status(folder, lambda shown: shown["state"] == "aborted")
    assert shown["reason"]
    assert states(folder)[-2:] == ["running", "aborted"]


def test_after_kill_9_the_run_is_found_interrupted_and_the_machine_is_free(
    folder: Path, worker: subprocess.Popen[bytes]
) -> None:
    until_status(folder, lambda shown: shown.get("executed", 0) > 20)
    os.kill(worker.pid, signal.SIGKILL)
    worker.wait(PATIENCE_S)
    assert not has_worker(folder)
    assert interrupt_orphans(folder.parent.parent) == [folder]
    assert states(folder)[-2:] == ["running", "interrupted"]


def test_one_machine_has_one_run(folder: Path) -> None:
    with MachineLock(read_job(folder).machine(folder), "run r0"), start_worker(folder) as worker:
        assert worker.wait(PATIENCE_S) == 6
    shown = status.read(folder)
    assert shown is not None
    assert shown["state"] == "faulted"
    assert "in use by run r0" in shown["reason"]
    assert states(folder) == ["queued", "faulted"]


def test_a_journal_that_is_locked_all_the_time_leaves_motion_and_gate_alone(folder: Path) -> None:
    data = folder.parent.parent
    connection = sqlite3.connect(journal_path(data), isolation_level=None)
    connection.execute("BEGIN IMMEDIATE")
    with start_worker(folder) as worker:
        flagged = until_status(folder, lambda shown: shown.get("journal_ok") is False)
        assert worker.wait(PATIENCE_S) == 0, (folder / "worker.log").read_text()
    assert flagged["state"] in ("running", "finishing", "completed")
    shown = status.read(folder)
    assert shown is not None
    assert (shown["state"], shown["executed"], shown["gate"]) == ("completed", 900, "closed")
    connection.execute("ROLLBACK")
    connection.close()
    assert states(folder) == ["queued"]
    interrupt_orphans(data)
    assert states(folder)[-3:] == ["running", "finishing", "completed"]
    assert transcript(folder)["stream"].count(b"PVA=") == 901


def test_a_pause_and_a_resume_are_in_the_journal_to_the_last_byte(folder: Path, tmp_path: Path) -> None:
    job = read_job(folder)
    assert job.address is not None
    with Proxy(job.address.host, job.address.port) as proxy:
        write_job(folder, job.model_copy(update={"address": job.address.model_copy(update={"port": proxy.port})}))
        with start_worker(folder) as worker:
            until_status(folder, lambda shown: shown.get("executed", 0) > 20)
            control.send(folder, {"act": "pause", "when": "now", "key": "k3"})
            until_status(folder, lambda shown: shown["state"] == "paused")
            control.send(folder, {"act": "resume", "key": "k3"})
            assert worker.wait(PATIENCE_S) == 0, (folder / "worker.log").read_text()
        seen = dict(zip(("stream", "status", "gate", "abort"), proxy.commands, strict=True))
    assert transcript(folder) == seen
    with Journal.open(journal_path(tmp_path)) as journal:
        known = history(journal, "r1")
        acts = [(event.data["act"], event.key) for event in journal.events(run="r1", kind="act")]
    assert acts == [("pause", "k3"), ("resume", "k3")]
    (begin, seam), (taken_up, end) = known.executed
    assert (begin, end) == (0, 900 * 60)
    assert taken_up == pytest.approx(seam, abs=1)
    with h5py.File(folder / "run.h5") as file:
        assert file["executed/plan_samples"][:].tolist() == [list(interval) for interval in known.executed]
        assert file["trace/sample"].size == sum(last - first for first, last in known.executed)


def test_a_resume_that_cannot_begin_leaves_the_run_as_it_was(folder: Path, tmp_path: Path) -> None:
    with Journal.open(journal_path(tmp_path)) as journal:
        for state in ("preflight", "moving_to_start", "armed", "running", "interrupted"):
            journal.append("r1", "state", {"state": state})
    job = read_job(folder)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        closed = listener.getsockname()[1]
    for address in (Address(host="127.0.0.1", port=closed), job.address):
        write_job(folder, job.model_copy(update={"resume_at": 6000, "address": address, "speed": 3.0}))
        with start_worker(folder) as worker:  # at first nobody answers, then the clock is wrong
            assert worker.wait(PATIENCE_S) in (5, 6)
        assert states(folder)[-2:] == ["resuming", "interrupted"]
    shown = status.read(folder)
    assert shown is not None
    assert shown["state"] == "interrupted"
    assert shown["reason"]
