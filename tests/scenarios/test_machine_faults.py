"""Whatever the machine or its network does in the middle of a run, the gate ends up closed and the run says so."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator

import pytest
from ibfctl_simulator.galil.clock import ScaledClock
from ibfctl_simulator.galil.control import ABORT_INPUT
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.inprocess import EmulatorServer
from ibfctl_simulator.galil.settings import Settings
from support.programs import connected, machine, program

from ibfctl.errors import RunError
from ibfctl.runs.streamer import execute

SPEED = 4.0
TIMEOUT_S = 1.0


@pytest.fixture
def server() -> Iterator[EmulatorServer]:
    with EmulatorServer(Controller(Settings(axes=2)), ScaledClock(SPEED)) as emulator:
        yield emulator


def run_into(server: EmulatorServer, fault: str, match: str, time_samples: int = 60) -> None:
    """Run until the first status line, then make `fault` happen."""
    bench = machine(port=server.port, timeout_s=TIMEOUT_S)
    lines = iter([lambda: server.fault(fault)])
    with connected(bench) as controller, pytest.raises(RunError, match=match):
        execute(
            program(400, time_samples),
            bench,
            controller,
            time_scale=SPEED,
            on_progress=lambda _: next(lines, lambda: None)(),
        )


def gate_is_open(server: EmulatorServer) -> bool:
    return bool(server.call(lambda: server.controller.state.outputs & 1))


STOPPED = "stopped with code|guard on the controller"
TRIPPED = "stopped with code [238] |a limit, a position error"


@pytest.mark.parametrize(
    ("fault", "match"),
    [
        ("limit axis=A side=forward", TRIPPED),
        ("limit axis=B side=reverse", TRIPPED),
        ("position-error axis=A counts=50000", TRIPPED),
        ("abort-input", STOPPED),
        ("e-stop", STOPPED),
        ("skew axis=B", "no longer execute the same segment|made up|executed"),
        ("refuse-pv at=7", "refused segment .* of axis"),
        ("drop handle=A", "no answer|about to run empty"),
        ("drop handle=B", "no answer"),
        ("garble handle=A", "stream link"),
        ("garble handle=B", "status link|no answer"),
        ("merge handle=B", "no answer|more than one reply"),
        ("half-open handle=A", "no answer|about to run empty"),
        ("half-open handle=B", "no answer"),
        ("reset handle=A", "run ended after|guard"),
        ("reset handle=B", "run ended after|guard"),
        ("reset", "run ended after|guard"),
        ("power-cycle", "run ended after"),
        ("sample-time scale=2.5", "did not end|lags|about to run empty"),
    ],
)
def test_a_fault_ends_the_run_with_the_gate_closed(server: EmulatorServer, fault: str, match: str) -> None:
    run_into(server, fault, match)
    assert not gate_is_open(server)


def test_the_guard_alone_closes_the_gate_after_the_abort_input(server: EmulatorServer) -> None:
    with connected(machine(port=server.port)) as controller:
        controller.start_guard(patience_s=60.0)
        with socket.create_connection(("127.0.0.1", server.port), timeout=10) as console:
            half_a_minute = b"PVA=1000,500,2048;PVB=0,0,2048\r" * 15
            console.sendall(b"SHAB\r" + half_a_minute + b"BTAB;SB 1\r")
            while not gate_is_open(server):
                time.sleep(0.001)
            server.fault("abort-input")
            deadline = time.monotonic() + 10
            while gate_is_open(server) and time.monotonic() < deadline:
                time.sleep(0.001)
        assert not gate_is_open(server)
        assert [axis.stop_code for axis in server.controller.state.axes] == [ABORT_INPUT] * 2


def test_a_controller_that_answers_nobody_closes_the_gate_itself(server: EmulatorServer) -> None:
    run_into(server, "half-open", "gate could not be closed", time_samples=60)
    assert not gate_is_open(server)
    stopped_by_the_guard = 4
    assert [axis.stop_code for axis in server.controller.state.axes] == [stopped_by_the_guard] * 2
