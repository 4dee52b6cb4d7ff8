"""Contour programs over the same stream, against the emulated controller."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
from support.programs import connected, contour, machine

from ibfctl.errors import AbortedError, RunError
from ibfctl.runs.emulator import emulated_controller
from ibfctl.runs.streamer import execute
from ibfctl.runs.trace import read_emulator_trace

SPEED = 20.0


@pytest.mark.parametrize("segments", [1, 254, 255, 256, 1200])
def test_a_contour_is_executed_to_the_last_count(segments: int, tmp_path: Path) -> None:
    job = contour(segments)
    with emulated_controller(tmp_path / "trace.h5", speed=SPEED) as emulated:
        bench = emulated.in_place_of(machine())
        with connected(bench) as controller:
            outcome = execute(job, bench, controller, time_scale=SPEED)
            assert not controller.gate_is_open()
    assert outcome.segments_executed == segments
    assert outcome.stop_codes == {"A": 51, "B": 51}
    assert outcome.final_position_error_counts == {"A": 0, "B": 0}
    trace = read_emulator_trace(tmp_path / "trace.h5", bench)
    for letter, axis in job.axes.items():
        nodes = axis.start_counts + np.cumsum(axis.increment_counts)
        exposed = trace.position_counts[letter][trace.gate_open]
        assert set(nodes.tolist()) <= set(exposed.tolist())


def test_a_contour_is_followed_by_another_run(tmp_path: Path) -> None:
    abort = threading.Event()
    with emulated_controller(None, speed=SPEED) as emulated:
        bench = emulated.in_place_of(machine())
        with connected(bench) as controller:
            with pytest.raises(AbortedError):
                execute(
                    contour(1200), bench, controller, time_scale=SPEED, abort=abort, on_progress=lambda _: abort.set()
                )
            assert execute(contour(20), bench, controller, time_scale=SPEED).segments_executed == 20


def test_a_host_that_stalls_closes_the_gate_before_the_contour_stands_still(tmp_path: Path) -> None:
    stalled = threading.Event()

    def stall(progress: object) -> None:
        if not stalled.is_set():
            stalled.set()
            threading.Event().wait(2 * 255 * 32 / 1024 / SPEED)

    with emulated_controller(tmp_path / "trace.h5", speed=SPEED) as emulated:
        bench = emulated.in_place_of(machine())
        with connected(bench) as controller, pytest.raises(RunError, match="about to run empty"):
            execute(contour(1200), bench, controller, time_scale=SPEED, on_progress=stall)
    trace = read_emulator_trace(tmp_path / "trace.h5", bench)
    closed = np.flatnonzero(trace.gate_open)[-1]
    assert any(np.any(np.diff(counts[closed:]) != 0) for counts in trace.position_counts.values())
