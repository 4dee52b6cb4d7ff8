"""plan.h5: what goes in comes out, the promised names are there, and damage is one clear line."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
import resource
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from ibfctl.errors import InputError
from ibfctl.planning.file import read_plan, read_plans, read_sequence, write_plan, write_sequence
from ibfctl.planning.plan import Plan
from ibfctl.planning.sequence import PlanSequence
from ibfctl.schedule.certificate import axis_cubics


@contextmanager
def edited(path: Path) -> Iterator[h5py.File]:
    """Change a plan file, and seal it again as if it had been written so."""
    with h5py.File(path, "r+") as file:
        yield file
    content = path.read_bytes()
    path.write_bytes(content + b"\nibfctl-sha256:" + hashlib.sha256(content).hexdigest().encode())


@pytest.fixture
def written(hand_made_plan: Plan, tmp_path: Path) -> Path:
    path = tmp_path / "plan.h5"
    write_plan(hand_made_plan, path)
    return path


def assert_same(one: Any, other: Any, where: str = "plan") -> None:
    """Equal all the way down: dataclasses, mappings, arrays with NaN."""
    if isinstance(one, np.ndarray):
        np.testing.assert_array_equal(other, one, err_msg=where)
        assert other.dtype == one.dtype, where
    elif dataclasses.is_dataclass(one):
        assert type(other) is type(one), where
        for field in dataclasses.fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name), f"{where}.{field.name}")
    elif isinstance(one, Mapping):
        assert set(one) == set(other), where
        for key in one:
            assert_same(one[key], other[key], f"{where}[{key}]")
    elif isinstance(one, tuple):
        assert len(one) == len(other), where
        for index, (left, right) in enumerate(zip(one, other, strict=True)):
            assert_same(left, right, f"{where}[{index}]")
    else:
        assert other == one, where


def test_a_plan_comes_back_as_it_was(hand_made_plan: Plan, written: Path) -> None:
    assert_same(hand_made_plan, read_plan(written))


def test_a_mere_schedule_comes_back_as_it_was(hand_made_plan: Plan, tmp_path: Path) -> None:
    schedule_only = dataclasses.replace(
        hand_made_plan, surface=None, influence=None, prediction=None, rounds=(), inputs={}
    )
    write_plan(schedule_only, tmp_path / "plan.h5")
    back = read_plan(tmp_path / "plan.h5")
    assert_same(schedule_only, back)
    assert "initial_rms_nm" not in back.summary()


def test_the_promised_names_are_there(hand_made_plan: Plan, written: Path) -> None:
    with h5py.File(written, "r") as file:
        for letter in "AB":
            group = file["program"][letter]
            for name in ("increment_counts", "end_velocity_counts_s", "time_samples"):
                assert group[name].shape == (len(hand_made_plan.program),)
                assert group[name].dtype == np.int64
            assert set(group.attrs) >= {"counts_per_mm", "start_mm", "sample_period_s"}
        assert np.array_equal(file["map/height_nm"][:], hand_made_plan.surface.height_nm, equal_nan=True)
        assert file["prediction/residual_nm"].shape == file["map/height_nm"].shape
        assert file["dwell/x_mm"].shape == file["dwell/y_mm"].shape == file["dwell/time_s"].shape
        assert file.attrs["version"]
        assert json.loads(file.attrs["inputs"])["map"] == {"name": "größe.npz", "sha256": "ab" * 32}


def test_the_promised_names_alone_are_enough_to_rebuild_the_motion(hand_made_plan: Plan, written: Path) -> None:
    program = hand_made_plan.program
    with h5py.File(written, "r") as file:
        for letter, axis in program.axes.items():
            group = file[f"program/{letter}"]
            scale, start_mm = float(group.attrs["counts_per_mm"]), float(group.attrs["start_mm"])
            h = group["time_samples"][:] * float(group.attrs["sample_period_s"])
            move_mm = group["increment_counts"][:] / scale
            velocity_mm_s = np.concatenate([[0.0], group["end_velocity_counts_s"][:] / scale])
            v0, v1 = velocity_mm_s[:-1], velocity_mm_s[1:]
            node_mm = start_mm + np.concatenate([[0.0], np.cumsum(move_mm)])
            u = 0.3
            rebuilt_mm = (
                node_mm[:-1] + (3 * u**2 - 2 * u**3) * move_mm + h * ((u**3 - 2 * u**2 + u) * v0 + (u**3 - u**2) * v1)
            )
            cubics = axis_cubics(program, axis)
            np.testing.assert_allclose(
                rebuilt_mm, cubics.position(u * cubics.time_s) / axis.counts_per_mm, rtol=0, atol=1e-9
            )
    # The first and the last node of the path, to half a count of 3276.8 per mm against x.
    assert start_mm == pytest.approx(hand_made_plan.path.y_mm[0], abs=1e-4)
    assert node_mm[-1] == pytest.approx(hand_made_plan.path.y_mm[-1], abs=1e-4)


def test_a_plan_replaces_the_one_before_and_leaves_nothing_beside_it(hand_made_plan: Plan, written: Path) -> None:
    write_plan(dataclasses.replace(hand_made_plan, planning_time_s=99.0), written)
    assert read_plan(written).planning_time_s == 99.0
    assert [path.name for path in written.parent.iterdir()] == ["plan.h5"]


@contextmanager
def full_disk(bytes_left: int) -> Iterator[None]:
    """No file may grow beyond `bytes_left`: writing fails as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_left, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("bytes_left", [0, 100, 5_000, 20_000])
def test_a_disk_that_fills_up_leaves_the_old_plan_and_no_half_written_one(
    hand_made_plan: Plan, written: Path, bytes_left: int
) -> None:
    before = written.read_bytes()
    assert bytes_left < len(before)
    with full_disk(bytes_left), pytest.raises(InputError, match=re.escape(str(written))) as caught:
        write_plan(hand_made_plan, written)
    assert "\n" not in str(caught.value)
    assert written.read_bytes() == before
    assert [path.name for path in written.parent.iterdir()] == ["plan.h5"]


@pytest.mark.parametrize(("place", "name"), [(h5py, "File"), (Path, "replace")])
def test_a_write_that_fails_leaves_the_old_plan_and_no_half_written_one(
    hand_made_plan: Plan, written: Path, monkeypatch: pytest.MonkeyPatch, place: object, name: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError("no space left")

    before = written.read_bytes()
    with monkeypatch.context() as broken:
        broken.setattr(place, name, fail)
        with pytest.raises(InputError, match="no space left") as caught:
            write_plan(hand_made_plan, written)
    assert str(written) in caught.value.message
    assert written.read_bytes() == before
    assert [path.name for path in written.parent.iterdir()] == ["plan.h5"]


def test_a_folder_that_is_not_there_and_a_place_that_is_taken(hand_made_plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        write_plan(hand_made_plan, tmp_path / "absent" / "plan.h5")
    (tmp_path / "taken").mkdir()
    with pytest.raises(InputError, match="is no file"):
        write_plan(hand_made_plan, tmp_path / "taken")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_plan(path)
    assert str(path) in caught.value.message
    assert "\n" not in str(caught.value)
    return caught.value.message


@pytest.mark.parametrize("content", [b"", b"not HDF5", b"\x89HDF\r\n\x1a\n", bytes(5000)])
def test_a_file_that_is_no_plan(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "plan.h5"
    path.write_bytes(content)
    assert "cannot be read" in refused(path)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert "cannot be read" in refused(tmp_path / "absent.h5")
    assert "cannot be read" in refused(tmp_path)


def test_a_foreign_hdf5_file(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["data"] = np.zeros(3)
    assert "no checksum" in refused(tmp_path / "other.h5")


def test_a_single_changed_byte_anywhere(written: Path) -> None:
    whole = written.read_bytes()
    for place in [*range(0, len(whole), len(whole) // 200), len(whole) - 1]:
        written.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert "checksum" in refused(written)


def test_a_plan_that_another_program_has_changed(written: Path) -> None:
    with h5py.File(written, "r+") as file:
        file["program/A"].attrs["counts_per_mm"] = 1.0
    assert "no checksum" in refused(written)


def test_a_plan_of_another_version(written: Path) -> None:
    with edited(written) as file:
        file.attrs["format"] = "ibfctl-plan/999"
    assert "not a plan of this version" in refused(written)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3, 0.5, 0.9, 0.999])
def test_a_truncated_plan(written: Path, share: float) -> None:
    whole = written.read_bytes()
    written.write_bytes(whole[: int(share * len(whole))])
    refused(written)


DAMAGE = {
    "no program": lambda file: file.__delitem__("program"),
    "one axis lost": lambda file: file.__delitem__("program/B"),
    "a column lost": lambda file: file.__delitem__("program/A/time_samples"),
    "no path": lambda file: file.__delitem__("path"),
    "no dwell times": lambda file: file.__delitem__("dwell/time_s"),
    "no machine": lambda file: file.attrs.__delitem__("machine"),
    "a machine that is none": lambda file: file.attrs.__setitem__("machine", "{}"),
    "a certificate that is none": lambda file: file.attrs.__setitem__("certificate", "passed, honestly"),
    "no scale": lambda file: file["program/A"].attrs.__delitem__("counts_per_mm"),
    "two axes for x": lambda file: file["program/B"].attrs.__setitem__("coordinate", "x"),
    "columns of different length": lambda file: (
        file.__delitem__("program/A/increment_counts"),
        file.__setitem__("program/A/increment_counts", np.zeros(3, dtype=np.int64)),
    ),
    "a group where a table should be": lambda file: (
        file.__delitem__("map/height_nm"),
        file.create_group("map/height_nm"),
    ),
    "a prediction without residual": lambda file: file.__delitem__("prediction/residual_nm"),
    "a map of another kind": lambda file: (
        file.__delitem__("map/height_nm"),
        file.__setitem__("map/height_nm", "text"),
    ),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_plan(written: Path, damage: str) -> None:
    with edited(written) as file:
        DAMAGE[damage](file)
    refused(written)


def test_the_spectra_are_those_of_the_maps(hand_made_plan: Plan, written: Path) -> None:
    assert hand_made_plan.prediction is not None
    with h5py.File(written) as file:
        for direction in ("x", "y", "radial"):
            group = file["psd"][direction]
            weight = group["weight"][:]
            assert group["frequency_per_mm"].shape == weight.shape
            for name, height_nm in (
                ("before", hand_made_plan.prediction.initial_nm),
                ("after", hand_made_plan.prediction.executed_residual_nm),
            ):
                assert (group[name][:] * weight).sum() == pytest.approx(np.nanmean(height_nm**2))


@pytest.fixture
def sequence(hand_made_plan: Plan) -> PlanSequence:
    assert hand_made_plan.surface is not None
    assert hand_made_plan.prediction is not None
    second = dataclasses.replace(hand_made_plan, planning_time_s=0.5, rounds=())
    return PlanSequence(
        (hand_made_plan, second),
        hand_made_plan.surface,
        hand_made_plan.prediction,
        "mto",
        120.0,
        hand_made_plan.rounds,
        hand_made_plan.inputs,
        3.5,
    )


def test_the_plan_of_several_tools_comes_back_as_it_was(sequence: PlanSequence, tmp_path: Path) -> None:
    path = tmp_path / "plan.h5"
    write_sequence(sequence, path)
    assert_same(sequence, read_sequence(path))
    assert_same(sequence.plans, read_plans(path))
    assert_same(sequence.plans[1], read_plan(path, tool=2))
    with h5py.File(path) as file:
        assert list(file["tools"]) == ["1", "2"]
        assert "program" not in file
        assert file["tools/2/program/A/increment_counts"].shape == (len(sequence.plans[1].program),)
        assert file["prediction/residual_nm"].shape == file["map/height_nm"].shape


def test_one_tool_makes_an_ordinary_plan_file(sequence: PlanSequence, tmp_path: Path) -> None:
    path = tmp_path / "plan.h5"
    write_sequence(dataclasses.replace(sequence, plans=sequence.plans[:1]), path)
    assert_same(sequence.plans[0], read_plan(path))
    assert_same(sequence.plans[:1], read_plans(path))
    with pytest.raises(InputError, match="not a plan of several tools"):
        read_sequence(path)


def test_which_of_several_tools_must_be_said_and_be_there(sequence: PlanSequence, tmp_path: Path) -> None:
    path = tmp_path / "plan.h5"
    write_sequence(sequence, path)
    with pytest.raises(InputError, match="holds the plans of 2 tools"):
        read_plan(path)
    for absent in (0, 3):
        with pytest.raises(InputError, match=f"no tool {absent}"):
            read_plan(path, tool=absent)


SEVERAL_DAMAGE = {
    "no tools": lambda file: file.__delitem__("tools"),
    "an empty list of tools": lambda file: (file.__delitem__("tools"), file.create_group("tools")),
    "a tool lost": lambda file: file.__delitem__("tools/1"),
    "a tool without its program": lambda file: file.__delitem__("tools/2/program"),
}


@pytest.mark.parametrize("damage", SEVERAL_DAMAGE)
def test_a_damaged_plan_of_several_tools(sequence: PlanSequence, tmp_path: Path, damage: str) -> None:
    path = tmp_path / "plan.h5"
    write_sequence(sequence, path)
    with edited(path) as file:
        SEVERAL_DAMAGE[damage](file)
    refused(path)


def test_a_plan_by_an_unknown_method(sequence: PlanSequence, tmp_path: Path) -> None:
    path = tmp_path / "plan.h5"
    write_sequence(sequence, path)
    with edited(path) as file:
        file.attrs["method"] = "magic"
    with pytest.raises(InputError, match="cannot be read"):
        read_sequence(path)
