"""The contract of the command line: names, keys and exit codes that other programs rely on."""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from ibfctl.cli.main import run
from tests.support.small_job import SmallJob

PLAN_KEYS = {
    "initial_rms_nm",
    "initial_pv_nm",
    "ideal_rms_nm",
    "executed_rms_nm",
    "executed_pv_nm",
    "total_time_s",
    "nodes",
    "segments",
    "peak_velocity_mm_s",
    "peak_acceleration_mm_s2",
    "certificate",
    "planning_time_s",
}
SIMULATE_KEYS = {
    "as_run_rms_nm",
    "as_run_pv_nm",
    "max_difference_nm",
    "segments_executed",
    "final_position_error_counts",
    "minimum_buffer_margin_s",
    "stop_codes",
}


def _json(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> dict[str, Any]:
    assert run([*arguments, "--json"]) == 0
    figures: dict[str, Any] = json.loads(capsys.readouterr().out)
    return figures


def test_plan_prints_its_figures_and_writes_the_documented_file(
    small_job: SmallJob, capsys: pytest.CaptureFixture[str]
) -> None:
    path = small_job.folder / "plan.h5"
    figures = _json(capsys, small_job.plan_arguments(path))
    assert set(figures) >= PLAN_KEYS
    assert figures["executed_rms_nm"] < 0.5 * figures["initial_rms_nm"]
    assert figures["certificate"]["passed"] is True
    assert all({"value", "limit", "passed"} <= set(check) for check in figures["certificate"]["checks"].values())
    assert set(figures["peak_velocity_mm_s"]) == {"A", "B"}
    with h5py.File(path) as file:
        for letter in ("A", "B"):
            axis = file[f"program/{letter}"]
            for name in ("increment_counts", "end_velocity_counts_s", "time_samples"):
                assert axis[name].shape == (figures["segments"],)
            assert {"counts_per_mm", "start_mm", "sample_period_s"} <= set(axis.attrs)
        assert file["prediction/residual_nm"].shape == file["map/height_nm"].shape
        assert file["dwell/x_mm"].shape == file["dwell/y_mm"].shape == file["dwell/time_s"].shape
        assert {len(item["sha256"]) for item in json.loads(file.attrs["inputs"]).values()} == {64}


def test_simulate_runs_every_segment_and_agrees_with_the_plan(
    small_plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.h5"
    figures = _json(capsys, ["simulate", str(small_plan), "--speed", "100", "-o", str(path)])
    assert set(figures) >= SIMULATE_KEYS
    assert figures["max_difference_nm"] < 0.02
    assert figures["final_position_error_counts"] == {"A": 0, "B": 0}
    assert figures["stop_codes"] == {"A": 31, "B": 31}
    assert figures["minimum_buffer_margin_s"] > 0
    with h5py.File(path) as file:
        assert file["as_run/residual_nm"].ndim == 2
        assert file["trace/A/position_counts"].shape == file["trace/gate_open"].shape
        assert {"plan", "map", "influence", "machine"} <= set(json.loads(file.attrs["inputs"]))


def test_timed_nodes_are_scheduled_and_simulated_without_a_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nodes, plan = tmp_path / "nodes.csv", tmp_path / "plan.h5"
    nodes.write_text("x_mm,y_mm,dwell_s\n0,0,0\n1,0,0.2\n2,0,0.25\n3,0,0.2\n3,1,0.3\n")
    figures = _json(capsys, ["schedule", str(nodes), "--machine", "simulator", "-o", str(plan)])
    assert figures["nodes"] == 5
    assert figures["total_time_s"] == pytest.approx(0.95, abs=2 / 1024)
    figures = _json(capsys, ["simulate", str(plan), "-o", str(tmp_path / "run.h5")])
    assert figures["as_run_rms_nm"] is None
    assert figures["segments_executed"] == 4


def test_a_maze_and_a_limit_on_time_may_be_asked_for(
    small_job: SmallJob, capsys: pytest.CaptureFixture[str]
) -> None:
    path = small_job.folder / "plan.h5"
    free = _json(capsys, small_job.plan_arguments(path, "--path", "maze", "--seed", "3"))
    assert free["certificate"]["passed"] is True
    share = 0.9 * free["total_time_s"]
    bound = _json(capsys, small_job.plan_arguments(path, "--path", "maze", "--seed", "3", "--max-time", str(share)))
    assert bound["total_time_s"] < free["total_time_s"]
    plain = _json(capsys, small_job.plan_arguments(path, "--no-loop"))
    assert plain["rounds"] == []


@pytest.mark.parametrize("form", ["csv", "pvt.csv", "pvt.dmc", "gcode"])
def test_export_writes_beside_the_plan(small_plan: Path, form: str) -> None:
    assert run(["export", str(small_plan), "--format", form]) == 0
    assert small_plan.with_suffix(f".{form}").read_text().count("\n") > 50


def test_islands_without_data_are_planned_around(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    height = np.load(small_job.map)["height_nm"]
    height[10:14, 20:25] = np.nan
    np.savez(small_job.map, height_nm=height, pixel_mm=0.25)
    figures = _json(capsys, small_job.plan_arguments(small_job.folder / "plan.h5"))
    assert figures["certificate"]["passed"] is True
    assert np.isfinite(figures["executed_rms_nm"])


def test_people_read_the_same_figures_in_words(
    small_plan: Path, small_job: SmallJob, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(small_job.plan_arguments(small_job.folder / "plan.h5")) == 0
    said = capsys.readouterr().out
    assert "executed residual" in said
    assert "certificate" in said
    assert run(["simulate", str(small_plan), "-o", str(small_job.folder / "run.h5")]) == 0
    assert "as-run residual" in capsys.readouterr().out
