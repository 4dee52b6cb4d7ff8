"""The same result however late the replies are and however fast the controller's clock runs."""

from __future__ import annotations

import threading
from itertools import product
from pathlib import Path

import pytest
from support.cubics import assert_executed_with_the_gate_open
from support.programs import connected, machine, program

from ibfctl.errors import AbortedError
from ibfctl.runs.emulator import emulated_controller
from ibfctl.runs.streamer import execute
from ibfctl.runs.trace import read_emulator_trace

LATENCIES_S = (0.0, 0.005, 0.05, 0.2)
SPEEDS = (0.5, 1.0, 2.0)
QUICK = {(0.005, 2.0)}

conditions = pytest.mark.parametrize(
    ("latency_s", "speed"),
    [
        pytest.param(*pair, marks=() if pair in QUICK else pytest.mark.slow)
        for pair in product(LATENCIES_S, SPEEDS)
    ],
)


def late(latency_s: float) -> tuple[str, ...]:
    return (f"delay seconds={latency_s}",) if latency_s else ()


@conditions
def test_a_run_is_the_same(latency_s: float, speed: float, tmp_path: Path) -> None:
    job = program(270, time_samples=30)
    with emulated_controller(tmp_path / "trace.h5", speed=speed, faults=late(latency_s)) as emulated:
        bench = emulated.in_place_of(machine())
        with connected(bench) as controller:
            outcome = execute(job, bench, controller, time_scale=speed)
    assert outcome.segments_executed == len(job)
    assert outcome.stop_codes == {"A": 31, "B": 31}
    assert outcome.final_position_error_counts == {"A": 0, "B": 0}
    assert_executed_with_the_gate_open(job, read_emulator_trace(tmp_path / "trace.h5", bench))


@conditions
def test_an_abort_is_the_same(latency_s: float, speed: float, tmp_path: Path) -> None:
    abort = threading.Event()
    with emulated_controller(tmp_path / "trace.h5", speed=speed, faults=late(latency_s)) as emulated:
        bench = emulated.in_place_of(machine())
        with connected(bench) as controller:
            with pytest.raises(AbortedError):
                execute(
                    program(270, time_samples=30),
                    bench,
                    controller,
                    time_scale=speed,
                    abort=abort,
                    on_progress=lambda _: abort.set(),
                )
            assert not controller.gate_is_open()
            assert not any(axis.moving for axis in controller.status().values())
