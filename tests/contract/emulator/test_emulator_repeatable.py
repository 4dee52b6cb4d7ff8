"""On a stepped clock a run is the same twice over, to the byte, whatever happens around it."""

from __future__ import annotations

import math

import pytest
from ibfctl_simulator.galil.clock import SteppedClock
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.inprocess import EmulatorServer
from ibfctl_simulator.galil.programs.memory import Program
from ibfctl_simulator.galil.servo import ServoModel
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.trace import TraceWriter

GUARD = Program(["#AUTO;n=0", "#L;WT 7;n=n+1", "IF(_SCA=32);CB1;ENDIF", "JP#L"])


def stream(path, make_client, servo, segments, time_samples, step_samples, program=GUARD):
    """Stream a wave to two axes over a socket with an open beam; return the bytes of the trace."""
    settings = Settings(motor_on_at_start=True, servo=servo)
    with TraceWriter(path, "AB", 1 / 1024) as trace:
        controller = Controller(settings, trace, program)
        with EmulatorServer(controller, SteppedClock()) as server, make_client(server.port) as client:
            lines = [
                f"PV{axis}={round(400 * math.sin(0.1 * k))},{round(4000 * math.sin(0.1 * k + 0.05))},{time_samples}"
                for k in range(segments)
                for axis in "AB"
            ]
            lines += ["PVA=0,0,0", "PVB=0,0,0"]
            sent = _send(client, lines, 0, 255)
            client.ask("SB 1;BTAB\r", 2)
            while "31.0000 31.0000" not in client.ask("MG _SCA,_SCB\r"):
                server.step(step_samples)
                free = float(client.ask("MG _PVA\r").split()[0])
                sent = _send(client, lines, sent, int(free))
            client.ask("CB 1\r")
            server.step(200)
    return path.read_bytes()


def _send(client, lines, sent, segments):
    batch = lines[sent : sent + 2 * segments]
    if batch:
        client.ask("".join(f"{line}\r" for line in batch), len(batch))
    return sent + len(batch)


@pytest.mark.parametrize("servo", [ServoModel(), ServoModel(kind="second_order", encoder_noise_counts=1.5)])
def test_two_runs_leave_the_same_bytes(tmp_path, make_client, servo):
    first, second = (
        stream(tmp_path / f"{name}.h5", make_client, servo, 600, 20, 1500) for name in ("first", "second")
    )
    assert len(first) > 20_000
    assert first == second


@pytest.mark.slow
def test_a_two_hour_job_twice(tmp_path, make_client):
    first, second = (
        stream(tmp_path / f"{name}.h5", make_client, ServoModel(), 72_000, 102, 20_000, Program())
        for name in ("first", "second")
    )
    assert first == second
