"""The guard on the controller closes the gate when the host no longer can."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from support.fake_galil import FakeGalil
from support.plans import plan_of
from support.programs import connected, machine, program

from ibfctl.errors import ControllerError, RunError
from ibfctl.machine.description import MachineDescription
from ibfctl.planning.file import write_plan
from ibfctl.runs.emulator import emulated_controller
from ibfctl.runs.streamer import execute
from ibfctl.runs.trace import RunTrace, read_emulator_trace

PATIENCE_S = machine().beam_gate.guard_patience_s
SAMPLE_S = 1 / 1024
AT_SPEED_SEGMENTS = 60  # both axes turn at once about the 133rd: a stop there is over within a sample


@contextmanager
def a_host_at_work(plan_file: Path, bench: MachineDescription) -> Iterator[subprocess.Popen[str]]:
    """A worker process in real time, as soon as the axes are at speed."""
    machine_file = plan_file.with_name("machine.json")
    machine_file.write_text(bench.model_dump_json())
    script = (
        "import sys; from pathlib import Path;"
        "from ibfctl.machine.description import MachineDescription; from ibfctl.planning.file import read_plan;"
        "from ibfctl.runs.drivers import connect; from ibfctl.runs.streamer import execute;"
        "machine = MachineDescription.model_validate_json(Path(sys.argv[1]).read_text());"
        "program = read_plan(Path(sys.argv[2])).program;"
        "execute(program, machine, connect(machine), on_progress=lambda at: print(at.executed, flush=True))"
    )
    command = [sys.executable, "-c", script, str(machine_file), str(plan_file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            while int(process.stdout.readline()) < AT_SPEED_SEGMENTS:
                pass
            yield process
        finally:
            process.kill()


def exposure(trace: RunTrace) -> np.ndarray:
    """Rows with the gate open."""
    return np.flatnonzero(trace.gate_open)


def still_moving_after(trace: RunTrace, row: int) -> bool:
    return any(np.any(np.diff(counts[row:]) != 0) for counts in trace.position_counts.values())


@pytest.mark.parametrize("how", [signal.SIGSTOP, signal.SIGKILL])
def test_a_host_that_is_gone_has_its_gate_closed_before_the_axes_stop(how: signal.Signals, tmp_path: Path) -> None:
    plan_file, trace_file = tmp_path / "plan.h5", tmp_path / "trace.h5"
    write_plan(plan_of(program(400, 20)), plan_file)
    with emulated_controller(trace_file) as emulated:
        bench = emulated.in_place_of(machine())
        with a_host_at_work(plan_file, bench) as host:
            host.send_signal(how)
            wait_until_closed(bench)
    trace = read_emulator_trace(trace_file, machine())
    last_open = exposure(trace)[-1]
    assert still_moving_after(trace, int(last_open)), "the axes were decelerating when the gate was closed already"
    lasted_s = (trace.sample[-1] - trace.sample[last_open]) * SAMPLE_S
    assert lasted_s < PATIENCE_S, "the axes were stopped, not left to run their buffers empty"


def wait_until_closed(bench: MachineDescription) -> None:
    """Ask over a handle of our own, as an operator's console would."""
    address = (bench.connection.host, bench.connection.port)
    with socket.create_connection(address, timeout=2 * PATIENCE_S) as console:
        reply = b"1"
        while b" 1" in reply or reply == b"1":
            console.sendall(b"MG @OUT[1],_BGA\r")
            reply = b""
            while not reply.endswith(b":"):
                reply += console.recv(100)


def test_the_guard_closes_the_gate_in_step_with_the_end(tmp_path: Path) -> None:
    trace_file, job = tmp_path / "trace.h5", program(20)
    with emulated_controller(trace_file) as emulated:
        bench = emulated.in_place_of(machine())
        with connected(bench) as controller:
            execute(job, bench, controller)
    trace = read_emulator_trace(trace_file, machine())
    assert len(exposure(trace)) - job.time_samples.sum() <= 20


def test_the_guard_is_loaded_once_and_then_left_alone() -> None:
    with FakeGalil() as galil, connected(machine(port=galil.port)) as controller:
        controller.start_guard(1.0)
        controller.start_guard(1.0)
        commands = [command for _, command in galil.log]
        assert commands.count("DL") == 1
        assert commands.count("XQ #IBFGRD,0") == 2
        assert max(map(len, galil.program)) <= 80


def test_a_gate_that_opens_when_clear_is_closed_by_setting_it() -> None:
    bench = machine()
    gate = bench.beam_gate.model_copy(update={"output": 3, "open_when": "clear"})
    with FakeGalil() as galil:
        galil.outputs[3] = 1
        connection = bench.connection.model_copy(update={"port": galil.port})
        with connected(bench.model_copy(update={"beam_gate": gate, "connection": connection})) as controller:
            controller.start_guard(1.0)
            controller.close_gate()
        assert "SB 3" in galil.program
        assert "JP #IBFGRD,@OUT[3]=1" in galil.program
        opening = galil.program.index("CB 3")
        assert galil.program[opening - 1] == "JP #IBFOPN,_BTA<gopen"
        assert galil.program.count("CB 3") == 1


def test_another_program_on_the_controller_is_not_overwritten() -> None:
    with FakeGalil() as galil:
        galil.program = ["#AUTO", "SB 7", "EN"]
        with connected(machine(port=galil.port)) as controller, pytest.raises(ControllerError, match="#AUTO"):
            controller.start_guard(1.0)
        assert galil.program == ["#AUTO", "SB 7", "EN"]


def spoilt(galil: FakeGalil) -> Callable[[int, str], bytes | None]:
    def fault(handle: int, command: str) -> bytes | None:
        if command == "UL" and galil.program:
            galil.program[5] = "NO"
        return None

    return fault


def test_a_guard_that_reads_back_otherwise_is_refused() -> None:
    with FakeGalil() as galil:
        galil.fault = spoilt(galil)
        with connected(machine(port=galil.port)) as controller, pytest.raises(ControllerError, match="read back"):
            controller.start_guard(1.0)


def test_a_guard_that_ended_ends_the_run() -> None:
    def end(handle: int, command: str) -> bytes | None:
        if sum(line.startswith("PVA") for _, line in galil.log) > 300:
            galil.guard_line = -1
        return None

    with FakeGalil(fault=end, sample_rate_hz=102_400) as galil:
        bench = machine(port=galil.port)
        with connected(bench) as controller, pytest.raises(RunError, match="guard on the controller"):
            execute(program(600, 2048), bench, controller, time_scale=100, poll_interval_s=0.002)
        assert galil.outputs[1] == 0
