"""Spectra are drawn whatever the map is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ibfctl.planning.plan import Prediction
from ibfctl.planning.spectra import spectra
from ibfctl.report.curves import draw_spectra

HEIGHTS = {
    "rough": np.random.default_rng(1).normal(size=(12, 20)),
    "flat": np.zeros((12, 20)),
    "one line": np.pad(np.ones((1, 20)), ((3, 3), (0, 0)), constant_values=np.nan),
    "one pixel": np.pad(np.ones((1, 1)), 4, constant_values=np.nan),
}


@pytest.mark.parametrize("kind", HEIGHTS)
def test_a_picture_of_any_map(tmp_path: Path, kind: str) -> None:
    before_nm = HEIGHTS[kind]
    prediction = Prediction(np.isfinite(before_nm), before_nm, before_nm, before_nm, 0.1 * before_nm)
    draw_spectra(spectra(prediction, 0.25), tmp_path / "psd.png")
    assert (tmp_path / "psd.png").read_bytes().startswith(b"\x89PNG")
