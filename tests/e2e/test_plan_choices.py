"""Choices of `ibfctl plan` about residual, time and regularisation."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ibfctl.cli.main import run
from ibfctl.planning.file import read_plan
from tests.support.small_job import SmallJob


@pytest.fixture
def path(small_job: SmallJob) -> Path:
    return small_job.folder / "plan.h5"


def _json(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> dict[str, Any]:
    capsys.readouterr()
    assert run([*arguments, "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


def test_a_wider_margin_buys_time(small_job: SmallJob, path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    narrow, wide = (_json(capsys, small_job.plan_arguments(path, "--margin", share)) for share in ("0.01", "0.5"))
    assert wide["total_time_s"] < 0.95 * narrow["total_time_s"]
    assert narrow["ideal_rms_nm"] < wide["ideal_rms_nm"] < 1.55 * narrow["ideal_rms_nm"]


def test_the_curve_is_printed_and_kept(small_job: SmallJob, path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figures = _json(capsys, small_job.plan_arguments(path, "--trade-off", "--no-loop"))
    curve = figures["trade_off"]
    assert len(curve) > 8
    assert (np.diff([point["total_time_s"] for point in curve]) > 0).all()
    assert (np.diff([point["rms_nm"] for point in curve]) < 0).all()
    (chosen,) = (point for point in curve if point["chosen"])
    assert chosen["rms_nm"] == pytest.approx(figures["ideal_rms_nm"], rel=1e-9)
    assert [vars(point) for point in read_plan(path).trade_off] == curve
    assert run(small_job.plan_arguments(path, "--trade-off")) == 0
    printed = capsys.readouterr().out
    assert printed.count("chosen") == 1
    assert "advised top speed" in printed


def test_the_tikhonov_factor_is_given_or_found(
    small_job: SmallJob, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    strong = _json(capsys, small_job.plan_arguments(path, "--tikhonov", "0.01"))
    found = _json(capsys, small_job.plan_arguments(path, "--tikhonov", "l-curve"))
    assert found["ideal_rms_nm"] < 0.2 * strong["ideal_rms_nm"]
    options = read_plan(path).options
    assert options.l_curve
    assert 1e-9 <= options.tikhonov < 1e-3
    assert "trade_off" not in found


@pytest.mark.parametrize("max_time", [20, 30, 60])
def test_a_run_time_is_used_and_kept(
    small_job: SmallJob, path: Path, capsys: pytest.CaptureFixture[str], max_time: int
) -> None:
    _json(capsys, small_job.plan_arguments(path, "--max-time", str(max_time), "--no-loop"))
    plan = read_plan(path)
    assert plan.dwell.time_s.sum() == pytest.approx(max_time, rel=1e-3)
    # What the limits of the machine lengthen comes on top.
    assert plan.program.total_time_s <= 1.04 * max_time


def test_a_slowest_speed_bounds_every_time(small_job: SmallJob, path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = small_job.plan_arguments(path, "--v-min-mm-s", "2", "--dwell-bounds", "ramp", "--no-loop")
    figures = _json(capsys, arguments)
    assert set(figures["dwell_bounds"]) == {"shortest_s", "longest_s", "steps_at_shortest", "steps_at_longest"}
    plan = read_plan(path)
    assert plan.options.dwell_bounds == "ramp"
    assert plan.program.time_s.max() <= figures["dwell_bounds"]["longest_s"] + 1e-9 < 0.5
    assert run(small_job.plan_arguments(path, "--v-min-mm-s", "1")) == 0
    assert "as --v-min-mm-s allows" in capsys.readouterr().out


@pytest.mark.parametrize("value", ["l-curves", "-1", "2", "nan"])
def test_what_is_no_factor_is_refused(
    small_job: SmallJob, path: Path, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(small_job.plan_arguments(path, "--tikhonov", value)) == 2
    assert "neither a factor" in capsys.readouterr().err
    assert not path.exists()


def test_terms_that_are_free_and_a_depth_that_goes_everywhere(
    small_job: SmallJob, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    choices = ("--remove", "legendre:2", "--extra-removal-nm", "20", "--no-loop")
    figures = _json(capsys, small_job.plan_arguments(path, *choices))
    plan = read_plan(path)
    assert (plan.options.remove, plan.options.extra_removal_nm) == ("legendre:2", 20.0)
    assert plan.prediction is not None
    assert plan.prediction.executed_removal_nm.min() > 15
    assert figures["executed_rms_nm"] < 0.2 < figures["initial_rms_nm"]
    run_path = small_job.folder / "run.h5"
    run_figures = _json(capsys, ["simulate", str(path), "--speed", "2000", "-o", str(run_path)])
    assert run_figures["as_run_rms_nm"] == pytest.approx(figures["executed_rms_nm"], abs=0.01)


@pytest.mark.parametrize("terms", ["tilts", "legendre:9", "zernike:0"])
def test_what_names_no_terms_is_refused(
    small_job: SmallJob, path: Path, terms: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(small_job.plan_arguments(path, "--remove", terms)) == 2
    assert "--remove none, piston" in capsys.readouterr().err


def test_rounded_corners_are_told_and_exported(
    small_job: SmallJob, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = small_job.plan_arguments(path, "--path", "maze", "--corner-tolerance-mm", "0.05")
    figures = _json(capsys, arguments)["smoothing"]
    assert figures["deviation_mm"] <= figures["corner_tolerance_mm"] == 0.05
    assert run([*arguments, "--no-loop"]) == 0
    assert "rounding lowers" in capsys.readouterr().out
    assert run(["export", str(path), "--format", "gcode"]) == 0
    lines = path.with_suffix(".gcode").read_text().splitlines()
    assert "SOFT G642 CTOL=0.05000" in lines
    assert any(line.startswith("; predicted cycle time") for line in lines)
