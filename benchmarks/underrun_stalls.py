"""Whether the gate closes before the buffer is empty when the whole host stalls for good at a random moment.

The driver streams to an emulated controller whose clock is stepped by hand, so that a thousand stalls take minutes. The
feeding is as slow as a bad network makes it: the buffer is at any depth when the stall comes, and nobody tells the
controller. What is left is the guard on it. `gate_first` counts the stalls after which the gate had closed and the
axes were stopped with motion still in the buffer; `least_margin_s` is the least motion that was left.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from ibfctl_simulator.galil.clock import SteppedClock
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.inprocess import EmulatorServer
from ibfctl_simulator.galil.settings import Settings

from benchmarks._streaming import machine, wave
from ibfctl.machine.controller import MotionController
from ibfctl.machine.program import PvtProgram
from ibfctl.runs.drivers import connect

STALLS = 1000
SEGMENTS = 400
TIMES_SAMPLES = (4, 10, 20, 60, 200, 600)
STEP_SAMPLES = 32
PATIENCE_S = 10.0
STOPPED_BY_GUARD = 4


def run() -> dict[str, Any]:
    """Stall a thousand times."""
    random = np.random.default_rng(7)
    first, margins = 0, []
    for number in range(STALLS):
        margin_s = _stall(random)
        first += margin_s > 0
        margins.append(margin_s)
        if number % 100 == 99:
            print(f"  {first} of {number + 1}", file=sys.stderr)
    metrics = {"gate_first": first, "stalls": STALLS, "least_margin_s": float(min(margins))}
    return {"metrics": metrics, "targets": {"gate_first": {"min": STALLS}}}


def _stall(random: np.random.Generator) -> float:
    """Stream up to a random moment and stop; return the seconds of motion left when the gate closed, or -1."""
    program = wave(SEGMENTS, int(random.choice(TIMES_SAMPLES)))
    clock = SteppedClock()
    with EmulatorServer(Controller(Settings(axes=2, motor_on_at_start=True)), clock) as server:
        bench = machine()
        connection = bench.connection.model_copy(update={"host": server.host, "port": server.port})
        controller = connect(bench.model_copy(update={"connection": connection}))
        try:
            sent = _stream_badly(program, controller, server, random)
            server.step(int(program.time_samples.sum()))
            stamps, status = controller.stamps(), controller.buffer_status()
            if stamps.begun is None or stamps.closed is None or status.gate_open:
                return -1.0
            left = int(program.time_samples[:sent].sum()) - (stamps.closed - stamps.begun)
            stopped = set(status.stop_codes.values()) == {STOPPED_BY_GUARD}
            return left * program.sample_period_s if stopped else -1.0
        finally:
            controller.close()


def _stream_badly(
    program: PvtProgram, controller: MotionController, server: EmulatorServer, random: np.random.Generator
) -> int:
    """Fill a random part of the buffer, begin, and feed too little for a random while; return the segments sent."""
    server.step(STEP_SAMPLES)
    controller.start_guard(PATIENCE_S)
    controller.prepare_segments(program)
    sent = int(random.integers(40, 250))
    controller.queue_segments(program, 0, sent)
    controller.begin_segments(0, len(program))
    for _ in range(int(random.integers(0, 60))):
        status = controller.buffer_status()
        if not status.guard_runs:
            break
        rows = min(int(random.integers(0, 4)), min(status.free_places.values()), len(program) - sent)
        if rows:
            controller.queue_segments(program, sent, sent + rows)
            sent += rows
        server.step(STEP_SAMPLES)
    return sent
