"""Several tools in sequence: confirmed changes, and later tools planned anew where the earlier ones missed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ibfctl.errors import AbortedError
from ibfctl.jobs import tools_rehearsal
from ibfctl.jobs.rehearsal import Rehearsal
from ibfctl.jobs.tools_rehearsal import rehearse_tools
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.as_run import AsRun
from ibfctl.planning.file import read_plans
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import InputFile, Plan
from ibfctl.planning.sequence import PlanSequence
from ibfctl.planning.several import plan_sequence
from ibfctl.planning.tool import Tool
from ibfctl.runs.outcome import RunOutcome
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import SurfaceMap
from tests.support.small_job import small_height_nm

MACHINE = read_machine(shipped_machine("simulator"))
PLAN_FILE = InputFile("plan.h5", "00" * 32)


@pytest.fixture(scope="module")
def sequence() -> PlanSequence:
    tools = [
        Tool(
            gaussian(fwhm_mm, 6.0, 1.25 * fwhm_mm, 0.25),
            MACHINE,
            PlanOptions(pitch_mm=pitch_mm, step_mm=pitch_mm, loop=False),
        )
        for fwhm_mm, pitch_mm in ((3.0, 1.5), (1.6, 0.8))
    ]
    return plan_sequence(SurfaceMap.centred(small_height_nm(), 0.25), tools)


class Emulated:
    """Runs that remove a share of what their plans predict."""

    def __init__(self, *shares: float) -> None:
        self.shares = iter(shares)
        self.plans: list[Plan] = []

    def __call__(self, plan: Plan, output: Path, **others: object) -> Rehearsal:
        assert plan.prediction is not None
        self.plans.append(plan)
        removal_nm = next(self.shares) * plan.prediction.executed_removal_nm
        outcome = RunOutcome(
            len(plan.program), len(plan.program), {"A": 31, "B": 31}, {"A": -1, "B": 0}, 2.0, 1.0, 1.0, 1 / 1024
        )
        return Rehearsal(outcome, AsRun(removal_nm, np.zeros_like(removal_nm), 0.0, 0.0, 0.0, 0.0))


def _confirmed(number: int, plan: Plan) -> None:
    pass


def test_tools_that_remove_what_was_predicted_follow_their_plans(
    sequence: PlanSequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    emulated = Emulated(1.0, 1.0)
    monkeypatch.setattr(tools_rehearsal, "rehearse", emulated)
    done = rehearse_tools(sequence, tmp_path / "run.h5", plan_file=PLAN_FILE, confirm=_confirmed)
    assert emulated.plans == list(sequence.plans)
    assert [run.replanned for run in done.runs] == [None, None]
    figures = done.summary()
    assert figures["as_run_rms_nm"] == pytest.approx(sequence.summary()["executed_rms_nm"])
    assert figures["rms_difference_nm"] == pytest.approx(0, abs=1e-9)
    assert figures["segments_executed"] == sequence.summary()["segments"]
    assert figures["final_position_error_counts"] == {"A": -1, "B": 0}
    assert [tool["run"] for tool in figures["tools"]] == ["run.tool1.h5", "run.tool2.h5"]


def test_what_the_first_tool_missed_the_second_makes_good(
    sequence: PlanSequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    emulated = Emulated(0.9, 1.0)
    monkeypatch.setattr(tools_rehearsal, "rehearse", emulated)
    done = rehearse_tools(sequence, tmp_path / "run.h5", plan_file=PLAN_FILE, confirm=_confirmed)
    first, second = emulated.plans
    assert first is sequence.plans[0]
    assert second.program.total_time_s > 1.05 * sequence.plans[1].program.total_time_s
    assert done.as_run.rms_nm < 2 * sequence.summary()["executed_rms_nm"]  # type: ignore[operator]
    replanned = done.runs[1].replanned
    assert replanned == tmp_path / "run.tool2.plan.h5"
    (written,) = read_plans(replanned)
    np.testing.assert_array_equal(written.program.time_samples, second.program.time_samples)


def test_a_change_of_tools_that_is_not_confirmed_stops(
    sequence: PlanSequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    emulated = Emulated(1.0, 1.0)
    monkeypatch.setattr(tools_rehearsal, "rehearse", emulated)
    asked = []

    def refuse(number: int, plan: Plan) -> None:
        asked.append((number, plan))
        raise AbortedError("not mounted")

    with pytest.raises(AbortedError):
        rehearse_tools(sequence, tmp_path / "run.h5", plan_file=PLAN_FILE, confirm=refuse)
    assert asked == [(2, sequence.plans[1])]
    assert emulated.plans == [sequence.plans[0]]
    assert not (tmp_path / "run.h5").exists()
