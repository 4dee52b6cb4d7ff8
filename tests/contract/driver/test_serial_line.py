"""The same driver over RS-232: one line for all duties."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
from support.fake_galil import FakeGalil
from support.programs import connected, machine, program
from support.serial_line import SerialLineTo

from ibfctl.errors import AbortedError, LinkError, RunError
from ibfctl.machine.description import MachineDescription
from ibfctl.runs.drivers import connect
from ibfctl.runs.streamer import execute

SCALE = 100


@pytest.fixture
def galil() -> Iterator[FakeGalil]:
    with FakeGalil(sample_rate_hz=1024 * SCALE) as fake:
        yield fake


@pytest.fixture
def line(galil: FakeGalil) -> Iterator[SerialLineTo]:
    with SerialLineTo(galil.port) as serial_line:
        yield serial_line


@pytest.fixture
def bench(line: SerialLineTo) -> MachineDescription:
    return machine(serial=line.path, timeout_s=1.0)


def test_a_run_over_a_line_that_echoes_at_first(galil: FakeGalil, bench: MachineDescription) -> None:
    with connected(bench) as controller:
        outcome = execute(program(600, 2048), bench, controller, time_scale=SCALE, poll_interval_s=0.002)
    assert outcome.segments_executed == 600
    assert galil.outputs[1] == 0
    assert {handle for handle, _ in galil.log} == {0}


def test_an_abort_breaks_into_the_line_and_closes_the_gate_first(
    galil: FakeGalil, bench: MachineDescription
) -> None:
    abort = threading.Event()
    with connected(bench) as controller, pytest.raises(AbortedError):
        execute(
            program(600, 2048),
            bench,
            controller,
            time_scale=SCALE,
            poll_interval_s=0.002,
            abort=abort,
            on_progress=lambda _: abort.set(),
        )
    commands = galil.sent(0)
    at = commands.index("AB")
    assert commands[at - 1] == "CB 1"
    assert "BT AB" in commands[:at]
    assert galil.outputs[1] == 0


def test_a_line_that_falls_silent_ends_the_run_and_the_gate_is_told_to_close(
    galil: FakeGalil, line: SerialLineTo, bench: MachineDescription
) -> None:
    with (
        connected(bench) as controller,
        pytest.raises(RunError, match="gate could not be closed"),
    ):
        execute(
            program(600, 2048),
            bench,
            controller,
            time_scale=SCALE,
            poll_interval_s=0.002,
            on_progress=lambda _: setattr(line, "silent", True),
        )
    assert galil.outputs[1] == 0, "the command arrived though the answer did not"


def test_a_port_that_does_not_exist_is_one_clear_error() -> None:
    with pytest.raises(LinkError, match="serial port /dev/nowhere cannot be reached"):
        connect(machine(serial="/dev/nowhere"))
