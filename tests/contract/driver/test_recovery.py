"""A killed worker, and what recovery finds: against the emulated controller's own trace."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from benchmarks.kill_recovery import Machine, Verdict, small_plan, try_out
from ibfctl.planning.file import write_plan
from ibfctl.runs.adoption import has_worker
from ibfctl.runs.emulator import emulated_controller
from ibfctl.runs.journal import Journal
from ibfctl.runs.records import as_run_of
from ibfctl.runs.recovery import resume
from ibfctl.runs.run_file import read_as_run
from ibfctl.runs.status import read
from ibfctl.runs.trace import read_emulator_trace
from ibfctl.runs.transcript import transcript
from ibfctl.surface.levelling import rms

SPEED = 30.0


def assert_right(verdicts: list[Verdict]) -> None:
    wrong = [f"{v.trial.found}, but {v.true_samples} samples, {v.removal_error_nm} nm" for v in verdicts if not v.right]
    assert wrong == []


def act(what: str, folder: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", "ibfctl.runs.recovery_act", what, str(folder)]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=False)
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def test_what_a_killed_worker_has_executed_is_known_to_the_sample() -> None:
    assert_right(try_out(2, seed=3))


@pytest.mark.slow
def test_wherever_a_worker_is_killed_what_it_has_executed_is_known() -> None:
    assert_right(try_out(20, seed=4))


def test_a_run_that_was_killed_twice_is_resumed_to_its_end_with_the_dose_of_the_plan(tmp_path: Path) -> None:
    plan = small_plan()
    write_plan(plan, tmp_path / "plan.h5")
    with emulated_controller(tmp_path / "trace.h5", speed=SPEED) as emulated:
        machine = Machine(tmp_path, emulated, tmp_path / "plan.h5")
        first = machine.killed(0.4, 0.0, once_moving=True)
        assert 0 < first.found.seam < plan.program.time_samples.sum()
        with resume(first.folder, first.found) as worker:
            while (read(first.folder) or {}).get("state") != "running":
                time.sleep(0.005)
            time.sleep(0.3)
            worker.kill()
        told = act("resume", first.folder)
        assert told["event"] == "finished", told
        (_, seam), (taken_up, later_seam) = told["figures"]["executed"]
        assert taken_up == pytest.approx(seam, abs=2)
        assert later_seam > seam == first.found.seam
        while has_worker(first.folder):
            time.sleep(0.01)
        told = act("recover", first.folder)
        assert told["figures"]["why_not"] == "the plan was executed to its end", told
        assert act("resume", first.folder)["event"] == "failed"
    assert plan.prediction is not None
    mask = plan.prediction.clear_aperture
    true = as_run_of(plan, read_emulator_trace(tmp_path / "trace.h5", plan.machine))
    said = read_as_run(first.folder / "run.h5")
    assert true is not None
    assert said is not None
    assert rms((true.removal_nm - plan.prediction.executed_removal_nm)[mask]) < 0.02
    assert rms((true.removal_nm - said.removal_nm)[mask]) < 0.002
    sent = transcript(first.folder)
    assert sent["stream"].count(b"BT AB") == 3
    with Journal.open(tmp_path / "journal.db") as journal:
        states = [event.data["state"] for event in journal.events(run=first.folder.name, kind="state")]
    again = ["interrupted", "resuming", "running"]
    before = ["queued", "preflight", "moving_to_start", "armed", "running"]
    assert states == [*before, *again, *again, "finishing", "completed"]
