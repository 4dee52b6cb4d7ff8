"""`ibfctl plan` and `compare` on spirals and random adaptive paths."""

import json

import numpy as np
import pytest

from ibfctl.cli.main import run
from ibfctl.planning.file import read_plan
from tests.support.small_job import PITCH, TIF, SmallJob

ROUND = ("--clear-aperture", "circle:0,0,3.5")


@pytest.mark.parametrize("path", ["spiral", "random"])
def test_a_round_part_is_planned_on_it(small_job: SmallJob, path: str, capsys: pytest.CaptureFixture[str]) -> None:
    output = small_job.folder / "plan.h5"
    assert run(small_job.plan_arguments(output, *ROUND, "--path", path, "--seed", "3", "--json")) == 0
    figures = json.loads(capsys.readouterr().out)
    assert read_plan(output).options.path == path
    assert figures["certificate"]["passed"]
    assert figures["executed_rms_nm"] < 0.3 * figures["initial_rms_nm"]
    assert figures["path"]["largest_gap_mm"] < {"spiral": 0.56, "random": 1.7}[path]


def test_a_spiral_may_start_in_the_middle(small_job: SmallJob) -> None:
    output = small_job.folder / "plan.h5"
    assert run(small_job.plan_arguments(output, *ROUND, "--path", "spiral", "--inside-out", "--no-loop")) == 0
    path = read_plan(output).path
    assert np.hypot(path.x_mm[0], path.y_mm[0]) < 1 < np.hypot(path.x_mm[-1], path.y_mm[-1])


def test_they_are_compared_with_the_others(small_job: SmallJob, capsys: pytest.CaptureFixture[str]) -> None:
    kinds = ("--path", "random", "--path", "spiral")
    job = ["compare", str(small_job.map), TIF, "--machine", str(small_job.machine), *PITCH, *ROUND]
    assert run([*job, *kinds, "--json"]) == 0
    compared = json.loads(capsys.readouterr().out)["paths"]
    assert list(compared) == ["random", "spiral"]
    for figures in compared.values():
        pvt = figures["schedulers"]["pvt, motion in the loop"]
        assert pvt["excursion_mm"] <= 0.05 + 1e-9
        assert pvt["executed_rms_nm"] > 0
