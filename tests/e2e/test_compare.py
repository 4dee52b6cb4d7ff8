"""`ibfctl compare` as other programs and people see it."""

import json

import pytest

from ibfctl.cli.main import run
from tests.support.small_job import PITCH, TIF, SmallJob

ROW_KEYS = {
    "overshoot_mm",
    "excursion_mm",
    "largest_acceleration_jump_mm_s2",
    "rms_acceleration_jump_mm_s2",
    "peak_acceleration_mm_s2",
    "peak_jerk_mm_s3",
    "total_time_s",
    "executed_rms_nm",
}


def _arguments(job: SmallJob, *more: str) -> list[str]:
    return ["compare", str(job.map), TIF, "--machine", str(job.machine), *PITCH, *more]


def test_json_holds_every_path_and_scheduler(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(_arguments(small_job, "--path", "maze", "--json")) == 0
    figures = json.loads(capsys.readouterr().out)
    assert set(figures["paths"]) == {"maze"}
    maze = figures["paths"]["maze"]
    assert set(maze["path"]) == {"length_mm", "shortest_step_mm", "sharpest_corner_deg", "largest_gap_mm"}
    assert len(maze["schedulers"]) == 5
    for row in maze["schedulers"].values():
        assert set(row) == ROW_KEYS
        assert row["executed_rms_nm"] > 0


def test_people_get_a_table_for_every_path(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(_arguments(small_job, "--path", "raster", "--jerk-max-mm-s3", "20000")) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines if "largest gap" in line] == ["raster x", "raster y"]
    rows = [line for line in lines if line.startswith("pvt, jerk limited")]
    assert len(rows) == 2
    assert all(len(row.split()) == 12 for row in rows)


def test_a_limit_of_the_jerk_must_be_positive(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(_arguments(small_job, "--jerk-max-mm-s3", "0")) == 2
    assert "--jerk-max-mm-s3" in capsys.readouterr().err


def test_methods_side_by_side(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(_arguments(small_job, "--path", "maze", "--methods", "--json")) == 0
    methods = json.loads(capsys.readouterr().out)["methods"]["maze"]
    assert {"inverse filter", "NNLS, then limits", "damped LSMR", "damped LSMR, extended", "ours"} <= set(methods)
    for row in methods.values():
        assert {"executed_rms_nm", "total_time_s", "slope_rms_s_mm", "peak_speed_mm_s", "planning_s"} <= set(row)
    assert run(_arguments(small_job, "--path", "maze", "--methods")) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith("maze")
    assert len(printed) == 2 + len(methods)


def test_methods_and_schedulers_are_not_compared_at_once(
    small_job: SmallJob, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(_arguments(small_job, "--methods", "--jerk-max-mm-s3", "20000")) == 2
    assert "--jerk-max-mm-s3" in capsys.readouterr().err
