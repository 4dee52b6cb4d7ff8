"""`ibfctl tif`: two maps make an influence function that `ibfctl plan` takes."""

import json
from pathlib import Path

import numpy as np
import pytest

from ibfctl.cli.main import run
from ibfctl.surface.readers import read_influence


def _maps(folder: Path, noise_nm: float) -> list[str]:
    y, x = np.mgrid[-3:3:61j, -3:3:61j]
    random = np.random.default_rng(4)
    before = random.normal(size=x.shape)
    after = before - 100 * np.exp(-(x**2 + y**2)) + 3 * x + noise_nm * random.normal(size=x.shape)
    np.savez(folder / "before.npz", height=before, pixel_mm=0.1)
    np.savez(folder / "after.npz", height=after, pixel_mm=0.1)
    return ["tif", str(folder / "before.npz"), str(folder / "after.npz"), "--dwell-s", "20", "--map-unit", "nm"]


def test_the_file_holds_what_the_figures_say(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "tif.npz"
    assert run([*_maps(tmp_path, 0.2), "-o", str(output), "--json"]) == 0
    captured = capsys.readouterr()
    figures = json.loads(captured.out)
    influence = read_influence(output)
    assert figures["peak_rate_nm_s"] == influence.peak_rate_nm_s == pytest.approx(5.0, rel=0.02)
    assert figures["volume_rate_nm_mm2_s"] == influence.volume_rate_nm_mm2_s == pytest.approx(5 * np.pi, rel=0.02)
    assert figures["noise_dominates"] is False
    assert captured.err == ""


def test_noise_is_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "tif.npz"
    assert run([*_maps(tmp_path, 15.0), "-o", str(output), "--radius-mm", "2"]) == 0
    captured = capsys.readouterr()
    assert captured.err.startswith("warning: the noise of 15")
    assert captured.err.count("\n") == 1
    assert [line.split("  ")[0] for line in captured.out.splitlines()][:2] == ["peak rate", "volume rate"]


def test_maps_in_the_wrong_order_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = _maps(tmp_path, 0.2)
    arguments[1:3] = arguments[2:0:-1]
    assert run([*arguments, "-o", str(tmp_path / "tif.npz")]) == 2
    assert capsys.readouterr().err.startswith("error: footprint: ")
    assert not (tmp_path / "tif.npz").exists()
