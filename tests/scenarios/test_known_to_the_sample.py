"""Whatever ends a run, its result says to the sample what was exposed, or by how much it may be wrong."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
from ibfctl_simulator.galil.clock import ScaledClock
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.inprocess import EmulatorServer
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.trace import TraceWriter
from support.plans import plan_of
from support.programs import connected, machine, program

from ibfctl.runs.conductor import conduct
from ibfctl.runs.requests import Requests
from ibfctl.runs.states import RunState
from ibfctl.runs.trace import read_emulator_trace

SPEED = 20.0
BUFFER_S = 60.0
ROUNDING_SAMPLES = 2


@pytest.mark.parametrize(
    ("fault", "state"),
    [
        ("limit axis=A side=forward", RunState.FAULTED),
        ("position-error axis=A counts=50000", RunState.FAULTED),
        ("refuse-pv at=7", RunState.FAULTED),
        ("drop handle=A", RunState.FAULTED),
        ("drop handle=B", RunState.FAULTED),
        ("reset", RunState.FAULTED),
        ("power-cycle", RunState.FAULTED),
        ("abort-input", RunState.ESTOPPED),
        ("e-stop", RunState.ESTOPPED),
    ],
)
def test_a_fault_leaves_no_doubt_about_the_dose(fault: str, state: RunState, tmp_path: Path) -> None:
    trace = TraceWriter(tmp_path / "trace.h5", "AB", 1 / 1024)
    controller = Controller(Settings(axes=2), trace)
    faults: list[Mapping[str, object]] = []
    with EmulatorServer(controller, ScaledClock(SPEED)) as server:
        strikes = iter([lambda: server.fault(fault)])

        def report(kind: str, data: Mapping[str, object]) -> None:
            if kind == "fault":
                faults.append(data)
            if kind == "progress" and float(str(data.get("progress", 0))) > 0.2:
                next(strikes, lambda: None)()

        bench = machine(port=server.port, timeout_s=0.4)
        gate = bench.beam_gate.model_copy(update={"guard_patience_s": 0.5})
        bench = bench.model_copy(update={"beam_gate": gate})
        with connected(bench) as link:
            result = conduct(plan_of(program(700)), bench, link, Requests(), report, time_scale=SPEED)
        server.call(lambda: controller.advance(round(BUFFER_S * 1024)))
        assert not controller.state.outputs
    trace.close()
    exposed = int(read_emulator_trace(tmp_path / "trace.h5", bench).gate_open.sum())
    ((opened, closed),) = result.executed_plan_samples
    assert result.state is state
    assert result.error is not None
    assert result.error.hint
    assert closed - opened - ROUNDING_SAMPLES <= exposed <= closed - opened + result.uncertainty_samples
    assert (result.uncertainty_samples == 0) == (fault != "power-cycle")
    if state is RunState.FAULTED:
        (told,) = faults
        assert told["hint"]
        assert told["place"]
