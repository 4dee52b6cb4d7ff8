"""`ibfctl export --map` of plans and runs."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from ibfctl.cli.main import run
from ibfctl.surface.readers import read_map


@pytest.mark.parametrize(("quantity", "name"), [("residual", "residual_nm"), ("removal", "removal_nm")])
def test_what_a_plan_predicts(small_plan: Path, tmp_path: Path, quantity: str, name: str) -> None:
    output = tmp_path / "m.h5"
    assert run(["export", str(small_plan), "--map", str(output), "--quantity", quantity]) == 0
    surface = read_map(output)
    with h5py.File(small_plan) as plan:
        np.testing.assert_array_equal(surface.height_nm, plan[f"prediction/{name}"][:])
        assert surface.x0_mm == plan["map/height_nm"].attrs["x0_mm"]


def test_what_a_run_has_left(small_plan: Path, tmp_path: Path) -> None:
    ran, output = tmp_path / "run.h5", tmp_path / "m.datx"
    assert run(["simulate", str(small_plan), "-o", str(ran)]) == 0
    assert run(["export", str(ran), "--map", str(output)]) == 0
    with h5py.File(ran) as file:
        np.testing.assert_array_equal(read_map(output).height_nm, file["as_run/residual_nm"][:])


def test_what_cannot_be_exported_is_refused(
    small_plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, message in (
        ([], "either --format or --map"),
        (["--map", "m.h5", "--format", "csv"], "either --format or --map"),
        (["--map", str(tmp_path / "m.png")], "not written as .png"),
        (["--map", str(tmp_path / "absent" / "m.h5")], "does not exist"),
    ):
        assert run(["export", str(small_plan), *arguments]) == 2
        assert message in capsys.readouterr().err
    changed = bytearray(small_plan.read_bytes())
    changed[len(changed) // 2] ^= 1
    for content in (b"no HDF5", changed, None):
        other = tmp_path / "other.h5"
        if content is None:
            with h5py.File(other, "w") as file:
                file.attrs["format"] = "something/1"
        else:
            other.write_bytes(content)
        assert run(["export", str(other), "--map", str(tmp_path / "m.h5")]) == 2
        assert str(other) in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [tmp_path / "other.h5"]
