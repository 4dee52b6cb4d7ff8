"""`ibfctl plan` for a part that does not stand in machine coordinates, and its run."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ibfctl.cli.main import run
from ibfctl.machine.placement import Placement
from ibfctl.planning.file import read_plan
from tests.support.small_job import SmallJob


def _json(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> dict[str, Any]:
    capsys.readouterr()
    assert run([*arguments, "--json"]) == 0
    return dict(json.loads(capsys.readouterr().out))


def _pairs(folder: Path, placement: Placement, error_mm: float = 0.0) -> str:
    part = np.array([[-6.0, -4.0], [6.0, -4.0], [6.0, 4.0]])
    machine = np.column_stack(placement(*part.T))
    machine[1, 0] += error_mm
    path = folder / "fiducials.csv"
    rows = [",".join(map(repr, row)) for row in np.column_stack([part, machine]).tolist()]
    path.write_text("\n".join(["part_x_mm,part_y_mm,machine_x_mm,machine_y_mm", *rows]))
    return str(path)


def test_a_turned_part_is_planned_and_run(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    path = small_job.folder / "plan.h5"
    where = ("--offset-mm", "10,-5", "--rotation-deg", "25", "--mirror")
    figures = _json(capsys, small_job.plan_arguments(path, *where, "--no-loop"))
    assert read_plan(path).options.placement == Placement(10.0, -5.0, 25.0, True)
    assert figures["placement"]["rotation_deg"] == 25.0
    assert figures["placement"]["fiducial_max_mm"] is None
    as_run = _json(capsys, ["simulate", str(path), "--speed", "2000", "-o", str(small_job.folder / "run.h5")])
    assert as_run["as_run_rms_nm"] == pytest.approx(figures["executed_rms_nm"], abs=0.01)
    assert as_run["max_difference_nm"] < 0.05


def test_fiducials_fix_the_placement(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    path = small_job.folder / "plan.h5"
    pairs = _pairs(small_job.folder, Placement(10.0, -5.0, 25.0, True), 0.03)
    arguments = small_job.plan_arguments(path, "--fiducials", pairs, "--mirror", "--no-loop")
    placement = _json(capsys, arguments)["placement"]
    assert placement["rotation_deg"] == pytest.approx(25.0, abs=0.2)
    assert 0.005 < placement["fiducial_rms_mm"] <= placement["fiducial_max_mm"] < 0.03
    assert run(arguments) == 0
    assert "fiducials off by" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("error_mm", "more", "said"),
    [
        (0.5, ("--mirror",), "fiducials: number 2 is"),
        (0.0, (), "the part is mirrored: correct --mirror"),
        (0.0, ("--mirror", "--rotation-deg", "3"), "--fiducials fixes"),
        (0.0, ("--offset-mm", "1"), "two numbers X,Y"),
    ],
)
def test_a_placement_that_cannot_be_is_refused(
    small_job: SmallJob, error_mm: float, more: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = small_job.folder / "plan.h5"
    pairs = _pairs(small_job.folder, Placement(10.0, -5.0, 25.0, True), error_mm)
    assert run(small_job.plan_arguments(path, "--fiducials", pairs, *more)) == 2
    assert said in capsys.readouterr().err
    assert not path.exists()
