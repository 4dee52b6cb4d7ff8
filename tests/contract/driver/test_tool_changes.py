"""A run of two tools by its worker: in sequence, each when confirmed, recovered between the tools and inside them."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from support.two_tools import two_tools

from ibfctl.errors import InputError
from ibfctl.jobs.rehearsal import rehearse
from ibfctl.jobs.replan_file import replan_file
from ibfctl.jobs.tool_runs import replan_tools_file
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.file import read_plans, write_sequence
from ibfctl.planning.plan import Plan
from ibfctl.planning.sequence import PlanSequence
from ibfctl.runs import control, status
from ibfctl.runs.adoption import interrupt_orphans
from ibfctl.runs.emulator import EmulatedController, emulated_controller
from ibfctl.runs.job import Address, Job, prepare, read_job
from ibfctl.runs.journal import Journal
from ibfctl.runs.launch import start_worker
from ibfctl.runs.lock import MachineLock
from ibfctl.runs.recovery import recover, resume
from ibfctl.runs.run_file import read_as_run
from ibfctl.runs.tools import plan_input
from ibfctl.runs.transcript import transcript
from ibfctl.surface.levelling import rms

SPEED = 50.0
WIDE_NM_S, NARROW_NM_S = 0.8, 2.0  # two seconds of the host for each tool: it is ended in the first tenth
PATIENCE_S = 30.0
OVER = ("completed", "faulted", "aborted")
TO_MOTION = ["preflight", "moving_to_start", "armed", "running"]
FIRST = ["queued", *TO_MOTION, "finishing", "tool_change"]


@pytest.fixture(scope="module")
def sequence() -> PlanSequence:
    return two_tools()


@pytest.fixture
def emulated(tmp_path: Path) -> Iterator[EmulatedController]:
    with emulated_controller(tmp_path / "trace.h5", speed=SPEED) as controller:
        yield controller


@pytest.fixture
def folder(tmp_path: Path, sequence: PlanSequence, emulated: EmulatedController) -> Path:
    return waiting_run(tmp_path, sequence, emulated, shipped_machine("simulator").read_text())


def waiting_run(data: Path, sequence: PlanSequence, emulated: EmulatedController, machine: str) -> Path:
    write_sequence(sequence, data / "plan.h5")
    (data / "machine.toml").write_text(machine)
    job = Job(run="r1", simulated=True, speed=SPEED, address=Address(host=emulated.host, port=emulated.port))
    return prepare(data, job, data / "plan.h5", data / "machine.toml")


def until(folder: Path, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        shown = status.read(folder)
        if shown is not None and condition(shown):
            return shown
        assert shown is None or shown["state"] not in OVER, str(shown)
        time.sleep(0.005)
    pytest.fail(f"status is still {shown}; {(folder / 'worker.log').read_text()}")


def until_state(folder: Path, *wanted: str) -> dict[str, Any]:
    return until(folder, lambda shown: shown["state"] in wanted)


def until_inside(folder: Path, tool: int) -> None:
    def inside(shown: dict[str, Any]) -> bool:
        return shown["state"] == "running" and shown["tool"] == tool and shown.get("progress", 0) > 0.02

    until(folder, inside)


def confirm(folder: Path) -> None:
    control.send(folder, {"act": "confirm"})


def ended(folder: Path, worker: subprocess.Popen[bytes]) -> int:
    code = worker.wait(PATIENCE_S)
    assert code in (0, 7), (folder / "worker.log").read_text()
    return code


def states(folder: Path) -> list[str]:
    with Journal.open(folder.parent.parent / "journal.db") as journal:
        return [event.data["state"] for event in journal.events(run="r1", kind="state")]


def assert_removed_as_planned(folder: Path, sequence: PlanSequence) -> None:
    mask = sequence.prediction.clear_aperture
    together = read_as_run(folder / "run.h5")
    parts = [read_as_run(folder / f"run.tool{number}.h5") for number in (1, 2)]
    assert together is not None
    np.testing.assert_allclose(sum(part.removal_nm for part in parts if part is not None), together.removal_nm)
    assert together.rms_difference_nm < 0.02
    assert float(np.abs(together.removal_nm - sequence.prediction.executed_removal_nm)[mask].max()) < 0.2
    with h5py.File(folder / "run.h5") as file:
        assert file.attrs["format"] == "ibfctl-tools-run/1"


def test_tools_run_in_sequence_each_when_it_is_confirmed(folder: Path, sequence: PlanSequence) -> None:
    with start_worker(folder) as worker:
        until_state(folder, "running")
        confirm(folder)  # too early: nothing was asked
        shown = until_state(folder, "tool_change")
        assert (shown["tool"], shown["tools"], shown["gate"]) == (1, 2, "closed")
        assert shown["reason"] == "tool 2 of 2 is to be mounted"
        with MachineLock(read_job(folder).machine(folder), "the test"):  # the machine is free to be homed
            pass
        confirm(folder)
        assert until_state(folder, "running")["tool"] == 2
        assert ended(folder, worker) == 0
    assert states(folder) == [*FIRST, *TO_MOTION, "finishing", "completed"]
    assert_removed_as_planned(folder, sequence)
    assert transcript(folder)["stream"].count(b"PVA=") == 2 + sum(len(plan.program) for plan in sequence.plans)


@pytest.mark.parametrize(("act", "end"), [("stop", "stopped"), ("estop", "estopped")])
def test_a_run_may_end_while_it_waits_for_a_tool(folder: Path, act: str, end: str) -> None:
    with start_worker(folder) as worker:
        until_state(folder, "tool_change")
        control.send(folder, {"act": act})
        assert ended(folder, worker) == 7
    assert states(folder) == [*FIRST, end]
    first, together = read_as_run(folder / "run.tool1.h5"), read_as_run(folder / "run.h5")
    assert first is not None
    assert together is not None
    np.testing.assert_array_equal(first.removal_nm, together.removal_nm)
    found = recover(folder)
    assert not found.can_resume
    latched = "an emergency stop is latched on the controller"
    assert found.why_not == (latched if act == "estop" else f"the run is {end}")


def test_a_worker_that_is_killed_between_the_tools_and_inside_the_second_loses_nothing(
    emulated: EmulatedController, tmp_path: Path
) -> None:
    sequence = two_tools(narrow_nm_s=NARROW_NM_S)
    folder = waiting_run(tmp_path, sequence, emulated, shipped_machine("simulator").read_text())
    with start_worker(folder) as worker:
        until_state(folder, "tool_change")
        worker.kill()
    assert interrupt_orphans(tmp_path) == [folder]
    between = recover(folder)
    first, second = (int(plan.program.time_samples.sum()) for plan in sequence.plans)
    assert (between.executed, between.can_resume) == (((0, first),), True)
    with resume(folder, between) as worker:
        until_state(folder, "tool_change")
        confirm(folder)
        until_inside(folder, 2)
        worker.kill()
    assert interrupt_orphans(tmp_path) == [folder]
    inside = recover(folder)
    ((begin, seam),) = inside.executed
    assert begin == 0
    assert 0 < seam < second
    assert (inside.uncertainty_samples, inside.can_resume) == (0, True)
    with resume(folder, inside) as worker:
        assert ended(folder, worker) == 0
    assert_removed_as_planned(folder, sequence)
    again = ["interrupted", "resuming"]
    assert states(folder) == [*FIRST, *again, "tool_change", *TO_MOTION, *again, "running", "finishing", "completed"]
    assert recover(folder).why_not == "the plan was executed to its end"


def test_what_the_first_tool_missed_the_second_is_planned_for_also_after_a_kill_inside_each(
    emulated: EmulatedController, tmp_path: Path
) -> None:
    sequence = two_tools(WIDE_NM_S, NARROW_NM_S)
    first, second = sequence.plans
    assert first.prediction is not None
    promised = replace(first.prediction, executed_removal_nm=1.2 * first.prediction.executed_removal_nm)
    promising = replace(sequence, plans=(replace(first, prediction=promised), second))
    folder = waiting_run(tmp_path, promising, emulated, shipped_machine("simulator").read_text())
    with start_worker(folder) as worker:
        until_inside(folder, 1)
        worker.kill()
    assert interrupt_orphans(tmp_path) == [folder]
    with resume(folder, recover(folder)) as worker:
        until_state(folder, "tool_change")
        confirm(folder)
        until_inside(folder, 2)
        worker.kill()
    assert interrupt_orphans(tmp_path) == [folder]
    (anew,) = read_plans(folder / "plan.tool2.h5")
    with resume(folder, recover(folder)) as worker:
        assert ended(folder, worker) == 0
    with h5py.File(folder / "run.tool2.h5") as file:
        assert file["executed/plan_samples"][-1, 1] == anew.program.time_samples.sum()
    with h5py.File(folder / "run.h5") as file:
        tools = json.loads(file.attrs["tools"])
    assert [tool["replanned"] for tool in tools] == [None, "plan.tool2.h5"]
    together = read_as_run(folder / "run.h5")
    assert together is not None
    assert together.rms_nm == pytest.approx(sequence.summary()["executed_rms_nm"], abs=0.05)


def test_what_the_preflight_of_a_later_tool_refuses_can_be_put_right(
    sequence: PlanSequence, emulated: EmulatedController, tmp_path: Path
) -> None:
    pressure = '[[interlocks]]\nname = "pressure"\nsource = "pushed"\nmin = 1.0\nmax = 2.0\nstale_s = 100.0\n'
    machine = shipped_machine("simulator").read_text() + pressure
    folder = waiting_run(tmp_path, sequence, emulated, machine)
    with start_worker(folder) as worker:
        control.send(folder, {"act": "interlock", "name": "pressure", "value": 1.5})
        until_state(folder, "tool_change")
        control.send(folder, {"act": "interlock", "name": "pressure", "value": 3.0})
        confirm(folder)
        until(folder, lambda shown: "pressure" in (shown.get("reason") or ""))
        control.send(folder, {"act": "interlock", "name": "pressure", "value": 1.5})
        with MachineLock(read_job(folder).machine(folder), "somebody"):
            confirm(folder)
            shown = until(folder, lambda shown: "in use by somebody" in (shown.get("reason") or ""))
        assert (shown["state"], shown["tool"]) == ("tool_change", 1)
        confirm(folder)
        assert ended(folder, worker) == 0
    refused = ["preflight", "tool_change"]
    assert states(folder) == [*FIRST, *refused, *refused, *TO_MOTION, "finishing", "completed"]
    assert_removed_as_planned(folder, sequence)


@pytest.mark.parametrize("tool", [1, 2])
def test_after_an_abort_inside_a_tool_its_rest_is_planned_and_the_later_ones_for_what_is_left(
    tool: int, emulated: EmulatedController, tmp_path: Path
) -> None:
    sequence = two_tools(wide_nm_s=WIDE_NM_S) if tool == 1 else two_tools(narrow_nm_s=NARROW_NM_S)
    folder = waiting_run(tmp_path, sequence, emulated, shipped_machine("simulator").read_text())
    with start_worker(folder) as worker:
        if tool == 2:
            until_state(folder, "tool_change")
            confirm(folder)
        until_inside(folder, tool)
        control.send(folder, {"act": "abort"})
        assert ended(folder, worker) == 7
    assert states(folder)[-1] == "aborted"
    assert (status.read(folder) or {})["gate"] == "closed"
    aborted = folder / f"run.tool{tool}.h5"
    left, rest = replan_file(aborted, tmp_path / "rest.h5")
    assert 0 < left.seam < int(sequence.plans[tool - 1].program.time_samples.sum())
    finished = executed(rest, folder, tmp_path / "rest-run.h5")
    if tool == 1:
        runs = [aborted, finished]
        with pytest.raises(InputError, match="not the completed run of one tool"):
            replan_tools_file(folder / "plan.h5", runs, tmp_path / "later.h5")
        (later,) = replan_tools_file(folder / "plan.h5", runs, tmp_path / "later.h5", done=1).plans
        finished = executed(later, folder, tmp_path / "later-run.h5")
    as_run = read_as_run(finished)
    assert as_run is not None
    assert as_run.rms_difference_nm < 0.02
    # How near it comes to the plan depends on the seam, which is where the host has it; doing a part of the work
    # twice, or not at all, leaves most of the error.
    assert as_run.rms_nm < 0.1 * rms(sequence.prediction.initial_nm[sequence.prediction.clear_aperture])


def executed(plan: Plan, folder: Path, output: Path) -> Path:
    rehearse(plan, output, plan_file=plan_input(folder), speed=400.0)
    return output
