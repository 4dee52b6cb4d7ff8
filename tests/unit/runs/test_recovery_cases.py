"""What recovery concludes from journal and controller, case by case; a controller that only answers questions."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import h5py
import pytest
from support.jobs import small_run

from ibfctl.errors import ControllerError, RunError
from ibfctl.machine.controller import Stamps
from ibfctl.machine.description import MachineDescription
from ibfctl.runs import status
from ibfctl.runs.adoption import interrupt_orphans
from ibfctl.runs.journal import Event, Journal
from ibfctl.runs.lock import take
from ibfctl.runs.places import LOCK, journal_path
from ibfctl.runs.recovery import Recovered, recover, resume

TOTAL = 200 * 60
PATIENCE_SAMPLES = round(2.25 * 1024)
NOW = 1_000_000
FIRST_LEG = ("leg", {"leg": 0, "first_plan_sample": 0, "open_at": 0})
MOVING: list[tuple[str, dict[str, Any]]] = [
    *(("state", {"state": state}) for state in ("preflight", "moving_to_start")),
    FIRST_LEG,
    ("state", {"state": "armed"}),
    ("state", {"state": "running"}),
]
ENDED = {"leg": 0, "first_plan_sample": 0, "open_at": 0, "uncertainty_samples": 0, "begun_samples": 5000}


class AnsweringController:
    """Notes in which order it is asked."""

    def __init__(self, stamps: Stamps | None, *, homed: bool = True, latched: bool = False, gate: bool = True) -> None:
        self._stamps = stamps
        self._homed = homed
        self._latched = latched
        self._gate = gate
        self.asked: list[str] = []

    def __call__(self, machine: MachineDescription) -> Any:
        return self

    def close_gate(self) -> None:
        self.asked.append("close_gate")
        if not self._gate:
            raise ControllerError("the beam gate could not be closed", "switch the beam off by hand now")

    def stop(self) -> None:
        self.asked.append("stop")

    def stop_guard(self) -> None:
        self.asked.append("stop_guard")

    def stamps(self) -> Stamps:
        self.asked.append("stamps")
        if self._stamps is None:
            raise ControllerError("controller refused 'MG gbeg,gopn,gcls,TIME'")
        return self._stamps

    def homed(self) -> dict[str, bool]:
        return {"A": True, "B": self._homed}

    def latched(self) -> bool:
        return self._latched

    def close(self) -> None:
        self.asked.append("close")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return small_run(tmp_path, 5023, speed=1.0, segments=200)


def happened(folder: Path, *events: tuple[str, dict[str, Any]]) -> None:
    data = folder.parent.parent
    with Journal.open(journal_path(data)) as journal:
        journal.write([Event("r1", kind, content) for kind, content in events])
    interrupt_orphans(data)


def stamps(begun: int, opened: int | None, closed: int | None) -> Stamps:
    return Stamps(begun, opened, closed, NOW)


def found(folder: Path, controller: AnsweringController) -> Recovered:
    recovered = recover(folder, controller)
    assert controller.asked[:3] == ["close_gate", "stop", "stop_guard"]
    assert controller.asked[-1] == "close"
    with h5py.File(folder / "run.h5") as file:
        assert [tuple(row) for row in file["executed/plan_samples"][:]] == list(recovered.executed)
    return recovered


def test_the_stamps_tell_to_the_sample(folder: Path) -> None:
    happened(folder, *MOVING)
    recovered = found(folder, AnsweringController(stamps(7000, 7000, 7000 + 4321)))
    assert recovered == Recovered(((0, 4321),), 0, 4321, can_resume=True, begun_samples=7000)
    shown = status.read(folder)
    assert shown is not None
    assert (shown["state"], shown["gate"]) == ("interrupted", "closed")


def test_a_gate_that_nobody_closed_was_open_to_the_end_of_the_plan_and_no_longer(folder: Path) -> None:
    happened(folder, *MOVING)
    recovered = found(folder, AnsweringController(stamps(7000, 7000, 7000 + TOTAL + 3)))
    assert recovered.executed == ((0, TOTAL),)
    assert recovered.why_not == "the plan was executed to its end"


def test_stamps_of_a_motion_before_this_run_are_not_taken_for_its_own(folder: Path) -> None:
    happened(folder, *MOVING[:3])
    before = NOW - round(1024 * (time.monotonic() + 3600))  # long before the leg was recorded
    recovered = found(folder, AnsweringController(Stamps(before, before, before + 4321, NOW)))
    assert (recovered.executed, recovered.seam, recovered.can_resume) == ((), 0, True)


def test_a_leg_whose_armed_state_did_not_reach_the_journal_is_told_by_the_clocks(folder: Path) -> None:
    happened(folder, *MOVING[:3])
    time.sleep(0.06)
    recovered = found(folder, AnsweringController(Stamps(NOW - 10, NOW - 10, NOW - 2, NOW)))
    assert recovered.executed == ((0, 8),)


def test_a_second_leg_starts_at_its_seam(folder: Path) -> None:
    paused = ("leg", {**ENDED, "end": "paused", "open_plan_samples": [0, 3000]})
    again = ("leg", {"leg": 1, "first_plan_sample": 3000, "open_at": 7})
    happened(folder, *MOVING, paused, *(("state", {"state": s}) for s in ("pausing", "paused", "resuming")), again)
    controller = AnsweringController(stamps(5000, 5000, 8000))
    assert found(folder, controller).executed == ((0, 3000),)  # the stamps are still those of the first leg
    happened(folder, again, ("state", {"state": "running"}))
    opened = 9000 + 600
    recovered = found(folder, AnsweringController(stamps(9000, opened, opened + 500)))
    assert recovered.executed[0] == (0, 3000)
    first, last = recovered.executed[1]
    assert last - first == 500


def test_what_the_worker_has_told_of_all_legs_needs_no_stamps(folder: Path) -> None:
    paused = ("leg", {**ENDED, "end": "paused", "open_plan_samples": [0, 3000]})
    happened(folder, *MOVING, paused, ("state", {"state": "pausing"}), ("state", {"state": "paused"}))
    recovered = found(folder, AnsweringController(None))
    assert recovered == Recovered(((0, 3000),), 0, 3000, can_resume=True)


def test_after_a_reset_a_run_is_refused_until_the_machine_is_homed(folder: Path) -> None:
    paused = ("leg", {**ENDED, "end": "paused", "open_plan_samples": [0, 3000]})
    happened(folder, *MOVING, paused, ("state", {"state": "pausing"}), ("state", {"state": "paused"}))
    recovered = found(folder, AnsweringController(None, homed=False))
    assert not recovered.can_resume
    assert "axis B is not homed" in recovered.why_not
    with pytest.raises(RunError, match="axis B is not homed"):
        resume(folder, recovered)
    assert found(folder, AnsweringController(None)).can_resume


def test_a_reset_while_moving_leaves_what_was_last_seen_and_says_how_sure_that_is(folder: Path) -> None:
    happened(folder, *MOVING, ("progress", {"place": {"plan_sample": 2000}}))
    status.write(folder, {"seq": 1, "place": {"plan_sample": 2100}})
    recovered = found(folder, AnsweringController(None))
    assert (recovered.executed, recovered.uncertainty_samples) == (((0, 2100),), 2304)
    assert recovered.uncertainty_samples == PATIENCE_SAMPLES
    assert not recovered.can_resume
    assert "2.25 s longer than is known: the controller was reset" in recovered.why_not
    again = found(folder, AnsweringController(None))
    assert (again.executed, again.uncertainty_samples) == (recovered.executed, recovered.uncertainty_samples)
    # Somebody has homed the machine and moved it since.
    later = found(folder, AnsweringController(stamps(NOW - 500, NOW - 500, NOW)))
    assert (later.executed, later.uncertainty_samples) == (recovered.executed, recovered.uncertainty_samples)


def test_a_worker_that_lost_its_link_is_put_right_by_the_stamps(folder: Path) -> None:
    lost = {**ENDED, "end": "faulted", "open_plan_samples": [0, 3000], "uncertainty_samples": 2048}
    happened(folder, *MOVING, ("leg", lost), ("state", {"state": "faulted"}))
    recovered = found(folder, AnsweringController(stamps(5000, 5000, 5000 + 4000)))
    assert (recovered.executed, recovered.uncertainty_samples) == (((0, 4000),), 0)
    assert recovered.why_not == "the run is faulted"


def test_stamps_of_a_later_motion_do_not_put_it_wrong(folder: Path) -> None:
    lost = {**ENDED, "end": "faulted", "open_plan_samples": [0, 3000], "uncertainty_samples": 2048}
    happened(folder, *MOVING, ("leg", lost), ("state", {"state": "faulted"}))
    recovered = found(folder, AnsweringController(stamps(9000, 9000, 9700)))
    assert (recovered.executed, recovered.uncertainty_samples) == (((0, 3000),), 2048)


def test_a_latched_emergency_stop_comes_before_everything(folder: Path) -> None:
    happened(folder, *MOVING)
    recovered = found(folder, AnsweringController(stamps(7000, 7000, 8000), latched=True, homed=False))
    assert "emergency stop is latched" in recovered.why_not


def test_a_run_that_never_moved_can_be_taken_up_from_its_begin(folder: Path) -> None:
    happened(folder, ("state", {"state": "preflight"}))
    recovered = found(folder, AnsweringController(None))
    assert (recovered.executed, recovered.seam, recovered.can_resume) == ((), 0, True)


def test_where_the_gate_cannot_be_closed_nothing_else_is_done(folder: Path) -> None:
    happened(folder, *MOVING)
    controller = AnsweringController(stamps(7000, 7000, 8000), gate=False)
    with pytest.raises(ControllerError, match="could not be closed"):
        recover(folder, controller)
    assert controller.asked == ["close_gate", "close"]


def test_a_run_whose_worker_lives_is_left_alone(folder: Path) -> None:
    lock = take(folder / LOCK, "its worker")
    assert lock is not None
    controller = AnsweringController(None)
    with pytest.raises(RunError, match="has a worker"):
        recover(folder, controller)
    assert controller.asked == []
    os.close(lock)
