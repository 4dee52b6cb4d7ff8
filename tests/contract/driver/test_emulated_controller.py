"""Real bytes over TCP: the driver against the emulated controller, an independent reading of the manuals."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.cubics import assert_executed_with_the_gate_open
from support.programs import connected, machine, program

from ibfctl.errors import AbortedError, ControllerError, RunError
from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import MachineDescription
from ibfctl.runs.drivers import connect
from ibfctl.runs.emulator import EmulatedController, emulated_controller
from ibfctl.runs.streamer import execute
from ibfctl.runs.trace import read_emulator_trace

SPEED = 20.0


@pytest.fixture
def trace_file(tmp_path: Path) -> Path:
    return tmp_path / "trace.h5"


@pytest.fixture
def emulated(trace_file: Path) -> Iterator[EmulatedController]:
    with emulated_controller(trace_file, speed=SPEED) as endpoint:
        yield endpoint


@pytest.fixture
def bench(emulated: EmulatedController) -> MachineDescription:
    return emulated.in_place_of(machine())


@pytest.fixture
def controller(bench: MachineDescription) -> Iterator[MotionController]:
    connected = connect(bench)
    yield connected
    connected.close()


@pytest.mark.parametrize("segments", [1, 2, 254, 255, 256, 700])
def test_a_program_is_executed_to_the_last_count(
    segments: int, bench: MachineDescription, controller: MotionController
) -> None:
    job = program(segments)
    outcome = execute(job, bench, controller, time_scale=SPEED)
    assert outcome.segments_sent == outcome.segments_executed == segments
    assert outcome.stop_codes == {"A": 31, "B": 31}
    assert outcome.final_position_error_counts == {"A": 0, "B": 0}
    assert outcome.minimum_buffer_margin_s > 0
    assert not controller.gate_is_open()


def test_the_trace_shows_the_cubics_with_the_gate_open(trace_file: Path) -> None:
    job = program(320)
    with emulated_controller(trace_file, speed=SPEED) as emulated:
        bench = emulated.in_place_of(machine())
        with connected(bench) as controller:
            execute(job, bench, controller, time_scale=SPEED)
    assert_executed_with_the_gate_open(job, read_emulator_trace(trace_file, bench))


def test_an_abort_closes_the_gate_and_stops_at_once(
    bench: MachineDescription, controller: MotionController
) -> None:
    abort = threading.Event()

    def abort_on_the_way(progress: object) -> None:
        abort.set()

    with pytest.raises(AbortedError):
        execute(program(700), bench, controller, time_scale=SPEED, abort=abort, on_progress=abort_on_the_way)
    assert not controller.gate_is_open()
    assert not any(axis.moving for axis in controller.status().values())


def test_a_second_run_follows_an_aborted_one(bench: MachineDescription, controller: MotionController) -> None:
    abort = threading.Event()
    with pytest.raises(AbortedError):
        execute(
            program(400), bench, controller, time_scale=SPEED, abort=abort, on_progress=lambda _: abort.set()
        )
    assert execute(program(20), bench, controller, time_scale=SPEED).segments_executed == 20


def test_a_host_that_stalls_closes_the_gate_before_the_buffer_is_empty(trace_file: Path) -> None:
    job = program(1000)
    stalled = threading.Event()
    seconds_of_buffer = 255 * 60 / 1024 / SPEED

    def stall(progress: object) -> None:
        if not stalled.is_set():
            stalled.set()
            threading.Event().wait(2 * seconds_of_buffer)

    with emulated_controller(trace_file, speed=SPEED) as emulated:
        bench = emulated.in_place_of(machine())
        with connected(bench) as controller:
            with pytest.raises(RunError, match="the buffer was about to run empty"):
                execute(job, bench, controller, time_scale=SPEED, on_progress=stall)
            assert {axis.stop_code for axis in controller.status().values()} == {4}, "stopped, not run empty"
    trace = read_emulator_trace(trace_file, bench)
    exposed = np.flatnonzero(trace.gate_open)
    closed, dry = exposed[-1], trace.sample.size - 1
    assert trace.sample[closed] < trace.sample[dry]
    moving = np.any([np.diff(trace.position_counts[letter][closed:]) != 0 for letter in "AB"], axis=0)
    assert moving.any(), "the axes still moved when the gate closed"


def test_a_wrong_sample_time_is_refused_before_anything_moves(
    bench: MachineDescription, controller: MotionController
) -> None:
    with pytest.raises(ControllerError, match="a sample of the controller lasts"):
        execute(program(10), bench, controller, time_scale=SPEED * 1.024)
    assert not any(axis.motor_on for axis in controller.status().values())


def test_an_abort_on_the_way_to_the_start_stops_the_axes(trace_file: Path) -> None:
    abort = threading.Event()

    def abort_once_it_moves() -> None:
        while controller.status()["A"].position_counts < 1000:
            pass
        abort.set()

    with emulated_controller(trace_file) as emulated:
        bench = emulated.in_place_of(machine())
        with connected(bench) as controller:
            watching = threading.Thread(target=abort_once_it_moves)
            watching.start()
            with pytest.raises(AbortedError):
                execute(program(20, start_counts=(90_000, 0)), bench, controller, abort=abort)
            watching.join()
            standing = controller.status()["A"]
    assert not standing.moving
    assert 1000 < standing.position_counts < 90_000
    assert not read_emulator_trace(trace_file, bench).gate_open.any()
