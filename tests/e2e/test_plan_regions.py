"""`ibfctl plan` on clear apertures of every kind."""

import json
from pathlib import Path

import numpy as np
import pytest

from ibfctl.cli.main import run
from ibfctl.planning.file import read_plan
from ibfctl.report.pictures import draw_plan
from ibfctl.surface.regions import Circle, MaskFile, Polygon
from tests.support.small_job import SmallJob

Y, X = np.meshgrid(0.25 * (np.arange(32) - 15.5), 0.25 * (np.arange(48) - 23.5), indexing="ij")
ROUND = np.hypot(X, Y) <= 3


@pytest.mark.parametrize("kind", ["circle", "polygon", "mask"])
@pytest.mark.parametrize("path", ["raster", "maze"])
def test_only_the_region_counts_and_only_its_surroundings_are_visited(
    small_job: SmallJob, kind: str, path: str, capsys: pytest.CaptureFixture[str]
) -> None:
    np.save(small_job.folder / "mask.npy", ROUND)
    (small_job.folder / "corners.csv").write_text("x_mm,y_mm\n-3,0\n0,-3\n3,0\n0,3\n")
    text = {"circle": "0,0,3", "polygon": small_job.folder / "corners.csv", "mask": small_job.folder / "mask.npy"}[kind]
    output = small_job.folder / "plan.h5"
    arguments = small_job.plan_arguments(output, "--clear-aperture", f"{kind}:{text}", "--path", path, "--json")
    assert run(arguments) == 0
    figures = json.loads(capsys.readouterr().out)
    plan = read_plan(output)
    region, inside = {
        "circle": (Circle(0, 0, 3), ROUND),
        "polygon": (Polygon(((-3, 0), (0, -3), (3, 0), (0, 3))), np.abs(X) + np.abs(Y) <= 3 + 1e-9),
        "mask": (MaskFile(Path(text)), ROUND),
    }[kind]
    assert plan.options.clear_aperture == region
    assert ("mask" in plan.inputs) == (kind == "mask")
    assert plan.prediction is not None
    assert np.array_equal(plan.prediction.clear_aperture, inside)
    assert figures["executed_rms_nm"] < (0.2 if path == "raster" else 0.4) * figures["initial_rms_nm"]
    assert figures["path"]["largest_gap_mm"] < 1.0
    nearest_mm = [
        np.hypot(X[inside] - x, Y[inside] - y).min() for x, y in zip(plan.path.x_mm, plan.path.y_mm, strict=True)
    ]
    assert max(nearest_mm) < 2 + 2.5  # the tool's radius, and at most a cell of the maze or a turn of the raster
    if path == "raster":
        assert all(picture.stat().st_size for picture in draw_plan(plan, small_job.folder))
