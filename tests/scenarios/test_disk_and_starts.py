"""What goes wrong beside the motion does not touch it: a disk that is full, a second run on the same machine."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from support.jobs import small_run

from ibfctl.runs import status
from ibfctl.runs.adoption import interrupt_orphans
from ibfctl.runs.detached_emulator import DetachedEmulator
from ibfctl.runs.journal import Journal
from ibfctl.runs.launch import start_worker
from ibfctl.runs.places import journal_path
from ibfctl.runs.transcript import transcript

PATIENCE_S = 30.0
SPEED = 10.0
SEGMENTS = 700
SMALL_BYTES = 4096
"""Enough for a status, and not for another page of the journal."""


@pytest.fixture(scope="module")
def emulator(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DetachedEmulator]:
    started = DetachedEmulator.start_or_adopt(tmp_path_factory.mktemp("emulator"), speed=SPEED)
    yield started
    started.end()


def until(folder: Path, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        shown = status.read(folder)
        if shown is not None and condition(shown):
            return shown
        time.sleep(0.005)
    pytest.fail(f"status is still {shown}; {(folder / 'worker.log').read_text()}")


def states(folder: Path) -> list[str]:
    with Journal.open(journal_path(folder.parent.parent)) as journal:
        return [event.data["state"] for event in journal.events(run=folder.name, kind="state")]


def test_a_disk_that_is_full_for_a_while_flags_the_run_and_leaves_motion_and_gate_alone(
    emulator: DetachedEmulator, tmp_path: Path
) -> None:
    folder = small_run(tmp_path, emulator.controller.port, SPEED, segments=SEGMENTS)
    with start_worker(folder) as worker:
        until(folder, lambda shown: shown.get("executed", 0) > 20)
        _, most = resource.prlimit(worker.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(worker.pid, resource.RLIMIT_FSIZE, (SMALL_BYTES, most))
        flagged = until(folder, lambda shown: shown.get("journal_ok") is False)
        moving = until(folder, lambda shown: shown["executed"] > flagged["executed"] + 20)
        assert (moving["state"], moving["gate"]) == ("running", "open")
        resource.prlimit(worker.pid, resource.RLIMIT_FSIZE, (most, most))
        assert worker.wait(PATIENCE_S) == 0, (folder / "worker.log").read_text()
    shown = status.read(folder)
    assert shown is not None
    assert (shown["state"], shown["executed"], shown["gate"]) == ("completed", SEGMENTS, "closed")
    interrupt_orphans(tmp_path)
    assert states(folder)[-3:] == ["running", "finishing", "completed"]
    assert transcript(folder)["stream"].count(b"PVA=") == SEGMENTS + 1


def test_of_two_runs_started_at_once_on_one_machine_one_moves_and_the_other_is_told_why(
    emulator: DetachedEmulator, tmp_path: Path
) -> None:
    folders = [small_run(tmp_path, emulator.controller.port, SPEED, run, SEGMENTS) for run in ("r1", "r2")]
    with start_worker(folders[0]) as first, start_worker(folders[1]) as second:
        codes = [first.wait(PATIENCE_S), second.wait(PATIENCE_S)]
    assert sorted(codes) == [0, 6]
    moved, refused = (folders[codes.index(code)] for code in (0, 6))
    assert states(moved)[-1] == "completed"
    assert states(refused) == ["queued", "faulted"]
    shown = status.read(refused)
    assert shown is not None
    assert f"in use by run {moved.name}" in shown["reason"]
