"""The trace: its rows, its layout, and that nothing is recorded while nothing happens."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.trace import TraceWriter


@pytest.fixture
def traced(tmp_path):
    path = tmp_path / "trace.h5"
    with TraceWriter(path, "AB", 1 / 1024) as trace:
        controller = Controller(Settings(motor_on_at_start=True), trace)

        def play(*steps):
            for step in steps:
                if isinstance(step, int):
                    controller.advance(step)
                else:
                    assert controller.reply(step, "A") == ":"
            trace.close()
            with h5py.File(path) as file:
                return {name: file[name][...] for name in file}, dict(file.attrs)

        yield play


def test_motion_and_an_open_beam_are_recorded_and_nothing_else(traced):
    rows, attributes = traced(100, "PVA=100,0,64", "PVA=0,0,0", "BTA", 80, "SB 2", 16, "CB 2", 50)
    assert attributes == {"format": "ibfctl-simulator-trace/1", "axes": "AB", "sample_period_s": 1 / 1024}
    assert rows["sample"].tolist() == [*range(101, 165), *range(181, 197)]
    assert rows["outputs"].tolist() == [0] * 64 + [2] * 16
    assert rows["position_counts"][[0, 63, -1]].tolist() == [[0, 0], [100, 0], [100, 0]]
    assert np.array_equal(rows["position_counts"], rows["commanded_counts"])
    assert {name: values.dtype.name for name, values in rows.items()} == {
        "sample": "int64",
        "position_counts": "int32",
        "commanded_counts": "int32",
        "outputs": "uint32",
    }


def test_both_axes_share_the_rows(traced):
    rows, _ = traced("PVA=100,0,64", "PVA=0,0,0", "PVB=-50,0,32", "PVB=0,0,0", "BTAB", 64)
    assert rows["position_counts"][31].tolist() == [50, -50]
    assert rows["position_counts"][63].tolist() == [100, -50]


def test_long_traces_are_written_in_pieces(traced):
    rows, _ = traced("SB 1", *[1000] * 20)
    assert rows["sample"].tolist() == list(range(1, 20_001))


def test_an_empty_trace_is_a_valid_file(traced):
    rows, _ = traced(5000)
    assert rows["position_counts"].shape == (0, 2)
