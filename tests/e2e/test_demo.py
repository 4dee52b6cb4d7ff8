"""The demo, whole but on a smaller part: from a seed to pictures of the as-run residual."""

import json
from pathlib import Path

import pytest
from PIL import Image

from ibfctl.cli.main import run
from ibfctl.cli.words import demo_table
from ibfctl.demo.job import PAPER_RMS_NM, demo_job
from ibfctl.demo.run import run_demo
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.aperture import clear_aperture_mask
from ibfctl.surface.levelling import Levelling, rms

SMALL = (64, 200)


def test_the_job_is_the_published_one() -> None:
    job = demo_job()
    assert job.surface.height_nm.shape == (168, 985)
    aperture = job.options.clear_aperture
    assert aperture is not None
    assert aperture.x1_mm - aperture.x0_mm == pytest.approx(92.0)
    assert aperture.y1_mm - aperture.y0_mm == pytest.approx(16.0)
    inside = clear_aperture_mask(job.surface, aperture)
    assert rms(Levelling.over(inside, "tilt")(job.surface.height_nm[inside])) == pytest.approx(PAPER_RMS_NM)
    assert 2 * job.influence.radius_mm == pytest.approx(5.0, abs=2 * job.influence.pixel_mm)
    assert (demo_job().surface.height_nm == job.surface.height_nm).all()
    assert (demo_job(seed=5).surface.height_nm != job.surface.height_nm).any()


def test_from_seed_to_pictures(tmp_path: Path) -> None:
    stages: list[str] = []
    machine = shipped_machine("simulator")
    demo = run_demo(
        demo_job(shape=SMALL), machine, tmp_path, speed=50, on_progress=lambda stage, fraction: stages.append(stage)
    )
    figures = demo.summary()
    assert figures["initial_rms_nm"] == pytest.approx(6.32)
    assert figures["as_run_rms_nm"] <= 0.30
    assert figures["rms_difference_nm"] <= 0.01
    assert figures["certificate"]["passed"] is True
    assert figures["final_position_error_counts"] == {"A": 0, "B": 0}
    json.dumps(figures)
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in demo.files}
    pictures = {path.name for path in demo.files if path.suffix == ".png"}
    assert pictures == {"map.png", "dwell.png", "velocities.png", "psd.png", "residuals.png"}
    for name in pictures:
        with Image.open(tmp_path / name) as picture:
            assert picture.width > 1000
            assert len(picture.convert("RGB").resize((64, 64)).getcolors(64 * 64)) > 50
    assert {"streaming", "as-run residual", "pictures"} <= set(stages)
    table = "\n".join(demo_table(figures, read_machine(machine)))
    assert "as-run " in table
    assert "mm/s²" in table


def test_the_verb_prints_both_sets_of_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small = demo_job(shape=SMALL)
    monkeypatch.setattr("ibfctl.demo.job.demo_job", lambda: small)
    assert run(["demo", "--out", str(tmp_path / "new" / "folder"), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert {"initial_rms_nm", "planning_time_s", "as_run_rms_nm", "stop_codes"} <= set(figures)
