"""What a service finds of runs when it starts."""

import os
from pathlib import Path

import pytest
from support.plans import plan_of
from support.programs import program

from ibfctl.errors import InputError
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.file import write_plan
from ibfctl.runs import status
from ibfctl.runs.adoption import has_worker, interrupt_orphans, last_state, living, run_folders
from ibfctl.runs.job import Address, Job, prepare, read_job
from ibfctl.runs.journal import Event, Journal
from ibfctl.runs.lock import take
from ibfctl.runs.places import LOCK, SIDE, journal_path


@pytest.fixture
def data(tmp_path: Path) -> Path:
    write_plan(plan_of(program(10)), tmp_path / "plan.h5")
    return tmp_path / "data"


def made(data: Path, run: str, *states: str) -> Path:
    folder = prepare(
        data, Job(run=run, operator="ann", key="k1"), data.parent / "plan.h5", shipped_machine("simulator")
    )
    with Journal.open(journal_path(data)) as journal:
        for state in states:
            journal.append(run, "state", {"state": state})
    return folder


def test_a_new_run_is_a_folder_of_copies_that_nobody_changes(data: Path) -> None:
    folder = made(data, "r1")
    assert (folder / "plan.h5").read_bytes() == (data.parent / "plan.h5").read_bytes()
    assert [(folder / name).stat().st_mode & 0o777 for name in ("plan.h5", "machine.toml")] == [0o444, 0o444]
    assert read_job(folder).operator == "ann"
    with Journal.open(journal_path(data)) as journal:
        (event,) = journal.events(run="r1")
        assert (event.data["state"], event.key) == ("queued", "k1")
    with pytest.raises(InputError, match="exists already"):
        made(data, "r1")


def test_a_job_may_name_another_address(data: Path) -> None:
    folder = made(data, "r1")
    job = Job(run="r1", address=Address(host="127.0.0.1", port=4711), simulated=True)
    assert job.machine(folder).connection.port == 4711
    assert job.machine(folder).homing.method == "absolute", "emulated encoders know where they are"
    assert Job(run="r1").machine(folder).connection.port == 5023


@pytest.mark.parametrize("text", ["", "{}", '{"run": "r1", "speed": 0}', '{"run": "r1", "colour": "red"}'])
def test_a_job_that_cannot_be_used_is_refused(data: Path, text: str) -> None:
    folder = made(data, "r1")
    (folder / "job.json").write_text(text)
    with pytest.raises(InputError, match=r"job .*job.json"):
        read_job(folder)


def test_only_runs_under_way_without_a_worker_are_interrupted(data: Path) -> None:
    queued = made(data, "r1")
    completed = made(data, "r2", "running", "finishing", "completed")
    alive = made(data, "r3", "running")
    dead = made(data, "r4", "running", "pausing")
    status.write(dead, {"run": "r4", "state": "pausing", "gate": "open", "executed": 7, "seq": 3})
    last_words = Event("r4", "state", {"state": "paused"})
    (dead / SIDE).write_text(f"{last_words.line()}\n")
    lock = take(alive / LOCK, "its worker")
    assert lock is not None
    assert run_folders(data) == [queued, completed, alive, dead]
    assert living(data) == [alive]
    assert interrupt_orphans(data) == [dead]
    assert interrupt_orphans(data) == []
    os.close(lock)
    assert not has_worker(alive)
    with Journal.open(journal_path(data)) as journal:
        states = [str(last_state(journal, f"r{number}")) for number in (1, 2, 3, 4)]
        assert states == ["queued", "completed", "running", "interrupted"]
        event = journal.last("r4", "state")
        assert event is not None
        assert event.data["was"] == "paused"  # from the side file
    shown = status.read(dead)
    assert shown is not None
    assert (shown["state"], shown["gate"], shown["executed"], shown["seq"]) == ("interrupted", "unknown", 7, 4)
