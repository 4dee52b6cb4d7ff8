"""How soon the guard closes the gate when worker, cable or link are gone at a random moment, in controller time.

A worker process streams in real time to an emulated controller, as it would to a real one, with the patience of the
guard that a machine file has by default. Then it is killed, or it hangs; or the controller neither hears nor answers
anybody any more (a cable that was pulled); or a single link is half-open: that of the stream, that of the questions, or
that of the gate, which carries the signs of life. The times from there to the last sample with the gate open are those
of the emulated controller's own trace; `worst_s` is the longest of all these. `ended_before` counts the runs that the
guard had ended before the fault, because this computer was too busy to give signs of life.
"""

from __future__ import annotations

import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from ibfctl_simulator.galil.clock import ScaledClock
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.inprocess import EmulatorServer
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.trace import TraceWriter

from benchmarks._killing import small_plan
from ibfctl.machine.description import BeamGate, read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.file import write_plan
from ibfctl.runs.job import Address, Job, prepare
from ibfctl.runs.launch import start_worker
from ibfctl.runs.status import read
from ibfctl.runs.trace import read_emulator_trace

TRIALS, ATTEMPTS = 10, 30
LATEST_S = 5.0
LARGEST_S = 0.5
START_TIMEOUT_S = END_TIMEOUT_S = 60.0
LOOK_S = 0.005
SAMPLE_S = 1 / 1024

Worker = subprocess.Popen[bytes]
Fault = Callable[[Worker, EmulatorServer], None]

HOST_GONE: dict[str, Fault] = {
    "killed": lambda worker, server: worker.kill(),
    "cable_pulled": lambda worker, server: server.fault("half-open"),
    "hung": lambda worker, server: worker.send_signal(signal.SIGSTOP),
}
HALF_OPEN: dict[str, Fault] = {
    f"half_open_{link}": lambda worker, server, handle=handle: server.fault(f"half-open handle={handle}")  # type: ignore[misc]
    for link, handle in (("stream", "A"), ("status", "B"), ("gate", "C"))
}


def run() -> dict[str, Any]:
    """Let every fault happen at ten random moments of a run."""
    chance = random.Random(11)
    plan = small_plan()
    patience_s = BeamGate(output=1).guard_patience_s
    metrics: dict[str, float] = {"patience_s": patience_s, "trials_of_each": TRIALS, "ended_before": 0}
    with tempfile.TemporaryDirectory(prefix="ibfctl-") as name:
        data = Path(name)
        write_plan(plan, data / "plan.h5")
        text = shipped_machine("simulator").read_text(encoding="utf-8")
        (data / "machine.toml").write_text(re.sub(r"(?m)^guard_patience_s.*\n", "", text), encoding="utf-8")
        for kind, fault in (HOST_GONE | HALF_OPEN).items():
            lasted_s, ended_before = _trials(data, kind, fault, chance)
            metrics["ended_before"] += ended_before
            metrics[f"{kind}_worst_s"], metrics[f"{kind}_mean_s"] = max(lasted_s), float(np.mean(lasted_s))
            print(f"  {kind}: {max(lasted_s):.3f} s", file=sys.stderr)
    metrics["worst_s"] = max(metrics[f"{kind}_worst_s"] for kind in HOST_GONE | HALF_OPEN)
    return {"metrics": metrics, "targets": {"worst_s": {"max": LARGEST_S}}}


def _trials(data: Path, kind: str, fault: Fault, chance: random.Random) -> tuple[list[float], int]:
    """Return the times of all trials with a fault, and how many runs a busy computer had ended before it."""
    lasted_s = list[float]()
    for number in range(ATTEMPTS):
        one = _trial(data, f"{kind}-{number}", fault, chance)
        lasted_s += [] if one is None else [one]
        if len(lasted_s) == TRIALS:
            return lasted_s, number + 1 - TRIALS
    raise RuntimeError(f"{kind}: {len(lasted_s)} of {ATTEMPTS} runs got as far as the fault; this computer is too busy")


def _trial(data: Path, run: str, fault: Fault, chance: random.Random) -> float | None:
    """Return how long the gate was open after a fault at a random moment, in s of the controller."""
    trace_file = data / f"{run}.h5"
    with TraceWriter(trace_file, "AB", SAMPLE_S) as trace:
        controller = Controller(Settings(axes=2), trace)
        state = controller.state
        with EmulatorServer(controller, ScaledClock(1.0)) as server:
            job = Job(run=run, address=Address(host=server.host, port=server.port))
            folder = prepare(data, job, data / "plan.h5", data / "machine.toml")
            with start_worker(folder) as worker:
                try:
                    _await(lambda: bool(state.outputs & 1) or worker.poll() is not None, START_TIMEOUT_S, folder)
                    time.sleep(chance.uniform(0.2, LATEST_S))
                    if not state.outputs & 1:
                        print(f"  {run}: {(read(folder) or {}).get('reason')}", file=sys.stderr)
                        return None
                    happened_at = server.call(lambda: state.sample)
                    fault(worker, server)
                    _await(lambda: not state.outputs & 1, END_TIMEOUT_S, folder)
                    time.sleep(LATEST_S / 10)
                finally:
                    worker.kill()
    executed = read_emulator_trace(trace_file, read_machine(data / "machine.toml"))
    return float(executed.sample[executed.gate_open][-1] - happened_at) * SAMPLE_S


def _await(condition: Callable[[], bool], timeout_s: float, folder: Path) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"{folder.name}: {read(folder)}")
        time.sleep(LOOK_S)
