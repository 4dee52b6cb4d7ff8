from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from support.programs import machine

from ibfctl.errors import InputError
from ibfctl.machine.description import MachineDescription
from ibfctl.runs.trace import read_emulator_trace


def write(path: Path, axes: str = "AB", width: int = 2) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["axes"] = axes
        file.attrs["sample_period_s"] = 1 / 1024
        file["sample"] = np.array([7, 8, 12], dtype=np.int64)
        file["position_counts"] = np.arange(3 * width, dtype=np.int32).reshape(3, width)
        file["outputs"] = np.array([0b10, 0b11, 0b01], dtype=np.uint32)


def machine_with_gate(output: int, open_when: str) -> MachineDescription:
    data = machine().model_dump()
    data["beam_gate"] = {"output": output, "open_when": open_when}
    return MachineDescription.model_validate(data)


def test_positions_go_by_axis_letter(tmp_path: Path) -> None:
    write(tmp_path / "trace.h5")
    trace = read_emulator_trace(tmp_path / "trace.h5", machine())
    assert trace.sample.tolist() == [7, 8, 12]
    assert trace.position_counts["A"].tolist() == [0, 2, 4]
    assert trace.position_counts["B"].tolist() == [1, 3, 5]
    assert trace.sample_period_s == 1 / 1024


@pytest.mark.parametrize(
    ("output", "open_when", "is_open"),
    [
        (1, "set", [False, True, True]),
        (2, "set", [True, True, False]),
        (1, "clear", [True, False, False]),
        (3, "set", [False, False, False]),
    ],
)
def test_the_gate_is_one_output_in_its_sense(
    tmp_path: Path, output: int, open_when: str, is_open: list[bool]
) -> None:
    write(tmp_path / "trace.h5")
    trace = read_emulator_trace(tmp_path / "trace.h5", machine_with_gate(output, open_when))
    assert trace.gate_open.tolist() == is_open


def test_what_is_no_trace_of_this_machine_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "trace.h5"
    with pytest.raises(InputError, match="cannot be read"):
        read_emulator_trace(path, machine())
    path.write_bytes(b"nothing")
    with pytest.raises(InputError, match="cannot be read"):
        read_emulator_trace(path, machine())
    path.unlink()
    write(path, axes="A", width=1)
    with pytest.raises(InputError, match="holds axes A"):
        read_emulator_trace(path, machine())
