"""`ibfctl replan`: from the run file of an interrupted run to a plan for the rest."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ibfctl.cli.main import run
from ibfctl.errors import InputError
from ibfctl.jobs.plan_files import hashed
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.as_run import as_run_figures
from ibfctl.planning.file import read_plan, write_plan
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import Plan
from ibfctl.planning.planner import make_plan, schedule_nodes
from ibfctl.planning.replan import removal_of_intervals
from ibfctl.runs.history import History
from ibfctl.runs.records import as_run_of, trace_of_history
from ibfctl.runs.run_file import RunRecord, read_as_run, read_remainder, write_run
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import SurfaceMap
from tests.support.small_job import small_height_nm


@pytest.fixture(scope="module")
def plan() -> Plan:
    surface, tool = SurfaceMap.centred(small_height_nm(), 0.25), gaussian(1.6, 4.0, 2.0, 0.1)
    return make_plan(surface, tool, read_machine(shipped_machine("simulator")), PlanOptions(pitch_mm=1.0, step_mm=1.0))


def interrupted(folder: Path, plan: Plan, executed: list[tuple[int, int]], uncertainty: int = 0) -> Path:
    write_plan(plan, folder / "plan.h5")
    trace = trace_of_history(plan, History(executed=executed))
    record = RunRecord(plan.machine, tuple(executed), uncertainty, trace, state="interrupted", run="r1", reason="why")
    write_run(folder / "run.h5", plan, hashed(folder / "plan.h5"), record, as_run_of(plan, trace))
    return folder / "run.h5"


def test_the_rest_of_a_run_is_planned_from_its_run_file_alone(
    tmp_path: Path, plan: Plan, capsys: pytest.CaptureFixture[str]
) -> None:
    path = interrupted(tmp_path, plan, [(0, 30_000), (30_000, 41_234)])
    (tmp_path / "plan.h5").unlink()
    assert run(["replan", str(path), "-o", str(tmp_path / "rest.h5"), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["executed_s"] == pytest.approx(41_234 / 1024)
    assert figures["uncertainty_s"] == 0
    assert figures["executed_rms_nm"] <= 1.05 * figures["first_executed_rms_nm"]
    rest = read_plan(tmp_path / "rest.h5")
    assert rest.inputs["run"].sha256 == hashed(path).sha256
    assert rest.surface is not None
    assert plan.surface is not None
    removed_nm = plan.surface.height_nm - rest.surface.height_nm
    assert np.allclose(removed_nm, removal_of_intervals(plan, [(0, 41_234)]), atol=2e-3)


def test_a_run_that_is_not_surely_known_says_so(tmp_path: Path, plan: Plan, capsys: pytest.CaptureFixture[str]) -> None:
    path = interrupted(tmp_path, plan, [(0, 41_234)], uncertainty=2048)
    assert run(["replan", str(path), "-o", str(tmp_path / "rest.h5")]) == 0
    assert "2.00 s" in capsys.readouterr().out


def test_a_run_that_has_removed_nothing_leaves_all(tmp_path: Path, plan: Plan) -> None:
    left = read_remainder(interrupted(tmp_path, plan, []))
    assert left.seam == 0
    assert not left.removal_nm.any()
    assert len(left.plan.program) == len(plan.program)
    assert read_as_run(tmp_path / "run.h5") is None


def test_what_cannot_be_planned_on_is_refused(tmp_path: Path, plan: Plan, capsys: pytest.CaptureFixture[str]) -> None:
    total = int(plan.program.time_samples.sum())
    path = interrupted(tmp_path, plan, [(0, total)])
    assert run(["replan", str(path), "-o", str(tmp_path / "rest.h5")]) == 2
    assert "nothing of the path is left" in capsys.readouterr().err
    assert not (tmp_path / "rest.h5").exists()
    with pytest.raises(InputError, match=r"not a run of one tool"):
        read_remainder(tmp_path / "plan.h5")
    with pytest.raises(InputError, match=r"cannot be read"):
        read_remainder(tmp_path / "absent.h5")
    timed = schedule_nodes(np.arange(4.0), np.zeros(4), np.array([0, 0.3, 0.3, 0.3]), plan.machine)
    with pytest.raises(InputError, match=r"its plan has no map"):
        read_remainder(interrupted(tmp_path, timed, [(0, 100)]))


def test_a_run_file_that_was_changed_is_refused(
    tmp_path: Path, plan: Plan, capsys: pytest.CaptureFixture[str]
) -> None:
    path = interrupted(tmp_path, plan, [(0, 41_234)])
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert run(["replan", str(path), "-o", str(tmp_path / "rest.h5")]) == 2
    assert "checksum does not fit" in capsys.readouterr().err
    assert not (tmp_path / "rest.h5").exists()
    with pytest.raises(InputError, match=r"run\.h5: cannot be read \(its checksum does not fit"):
        read_as_run(path)


def test_where_the_stages_were_seen_counts_more_than_where_they_should_have_been(plan: Plan) -> None:
    executed = [(0, 20_000), (20_000, 40_000)]
    planned = trace_of_history(plan, History(executed=executed))
    assert planned is not None
    seen = []
    for sample in range(500, 40_000, 1000):
        at = sample - 1  # rows begin with sample 1
        x_mm, y_mm = (planned.position_counts[letter][at] / 10_000 for letter in ("A", "B"))
        seen.append((sample, x_mm + 0.01, y_mm))
    beyond = [(90_000, 1e6, 1e6)]
    trace = trace_of_history(plan, History(executed=executed, places=seen + beyond))
    assert trace is not None
    assert np.abs(trace.position_counts["A"] - planned.position_counts["A"] - 100).max() <= 1
    assert np.abs(trace.position_counts["B"] - planned.position_counts["B"]).max() <= 1
    as_run = as_run_of(plan, trace)
    assert as_run is not None
    x_mm, y_mm = (planned.position_counts[letter] / 10_000 for letter in ("A", "B"))
    shifted = as_run_figures(plan, x_mm + 0.01, y_mm, plan.program.sample_period_s)
    # Positions are counts: each sample is up to one off along either axis.
    assert plan.surface is not None
    steepest_nm_mm = np.hypot(*np.gradient(shifted.removal_nm, plan.surface.pixel_mm)).max()
    assert np.abs(as_run.removal_nm - shifted.removal_nm).max() <= np.sqrt(2) / 10_000 * steepest_nm_mm
