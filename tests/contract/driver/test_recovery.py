"""A killed worker, and what recovery finds: against the emulated controller's own trace."""

from __future__ import annotations

import time
from pathlib import Path

import h5py
import pytest
from support.proxy import Proxy

from benchmarks._killing import SPEED, Verdict, small_plan, try_out, waiting_run, write_inputs
from ibfctl.errors import RunError
from ibfctl.runs.adoption import interrupt_orphans
from ibfctl.runs.emulator import emulated_controller
from ibfctl.runs.job import Address, read_job, write_job
from ibfctl.runs.journal import Journal
from ibfctl.runs.launch import start_worker
from ibfctl.runs.records import as_run_of
from ibfctl.runs.recovery import recover, resume
from ibfctl.runs.run_file import read_as_run
from ibfctl.runs.status import read
from ibfctl.runs.trace import read_emulator_trace
from ibfctl.runs.transcript import transcript
from ibfctl.surface.levelling import rms


def until_state(folder: Path, state: str) -> None:
    deadline = time.monotonic() + 30
    while (read(folder) or {}).get("state") != state:
        assert time.monotonic() < deadline, (folder / "worker.log").read_text()
        time.sleep(0.005)


def assert_right(verdicts: list[Verdict]) -> None:
    wrong = [f"{v.trial.found}, but {v.true_samples} samples, {v.removal_error_nm} nm" for v in verdicts if not v.right]
    assert wrong == []


def test_what_a_killed_worker_has_executed_is_known_to_the_sample() -> None:
    assert_right(try_out(1, seed=5, served=False))


@pytest.mark.slow
@pytest.mark.parametrize("served", [False, True])
def test_whenever_a_worker_or_a_service_is_killed_what_was_executed_is_known(served: bool) -> None:
    assert_right(try_out(12, seed=4, served=served))


def test_a_run_that_was_killed_twice_is_resumed_to_its_end_with_the_dose_of_the_plan(tmp_path: Path) -> None:
    plan = small_plan()
    write_inputs(plan, tmp_path)
    with emulated_controller(tmp_path / "trace.h5", speed=SPEED) as emulated:
        folder = waiting_run(tmp_path, emulated, "r1")
        with start_worker(folder) as worker:
            until_state(folder, "running")
            time.sleep(0.4)
            worker.kill()
        assert interrupt_orphans(tmp_path) == [folder]
        first = recover(folder)
        assert 0 < first.seam < plan.program.time_samples.sum()
        with resume(folder, first) as worker:
            until_state(folder, "running")
            time.sleep(0.3)
            worker.kill()
        assert interrupt_orphans(tmp_path) == [folder]
        second = recover(folder)
        assert second.seam > first.seam
        (_, seam), (taken_up, _) = second.executed
        assert taken_up == pytest.approx(seam, abs=2)
        with resume(folder, second) as worker:
            assert worker.wait(60) == 0, (folder / "worker.log").read_text()
        third = recover(folder)
        assert third.why_not == "the plan was executed to its end"
        with pytest.raises(RunError, match="cannot be resumed: the plan was executed to its end"):
            resume(folder, third)
    assert plan.prediction is not None
    mask = plan.prediction.clear_aperture
    true = as_run_of(plan, read_emulator_trace(tmp_path / "trace.h5", plan.machine))
    said = read_as_run(folder / "run.h5")
    assert true is not None
    assert said is not None
    assert rms((true.removal_nm - plan.prediction.executed_removal_nm)[mask]) < 0.02
    assert rms((true.removal_nm - said.removal_nm)[mask]) < 0.002
    sent = transcript(folder)
    assert sent["stream"].count(b"BT AB") == 3
    with Journal.open(tmp_path / "journal.db") as journal:
        states = [event.data["state"] for event in journal.events(run=folder.name, kind="state")]
    again = ["interrupted", "resuming", "running"]
    before = ["queued", "preflight", "moving_to_start", "armed", "running"]
    assert states == [*before, *again, *again, "finishing", "completed"]


def test_a_cable_that_is_pulled_and_put_back_leaves_no_doubt(tmp_path: Path) -> None:
    plan = small_plan()
    write_inputs(plan, tmp_path)
    with emulated_controller(tmp_path / "trace.h5", speed=SPEED) as emulated:
        folder = waiting_run(tmp_path, emulated, "r1")
        with Proxy(emulated.host, emulated.port) as cable:
            address = Address(host="127.0.0.1", port=cable.port)
            write_job(folder, read_job(folder).model_copy(update={"address": address}))
            worker = start_worker(folder)
            until_state(folder, "running")
            time.sleep(0.3)
        until_state(folder, "faulted")
        with Proxy(emulated.host, emulated.port, at=cable.port), worker:
            assert worker.wait(60) == 6, (folder / "worker.log").read_text()
    trace = read_emulator_trace(tmp_path / "trace.h5", plan.machine)
    with Journal.open(tmp_path / "journal.db") as journal:
        ended, recovered = journal.last("r1", "leg"), journal.last("r1", "recovered")
    assert ended is not None
    assert ended.data["uncertainty_samples"] > 0
    assert recovered is not None
    assert recovered.data["uncertainty_samples"] == 0
    assert recovered.data["executed"] == [[0, int(trace.gate_open.sum())]]
    shown = read(folder)
    assert shown is not None
    assert (shown["state"], shown["gate"]) == ("faulted", "closed")
    with h5py.File(folder / "run.h5") as file:
        assert file["executed/plan_samples"][:].tolist() == recovered.data["executed"]
