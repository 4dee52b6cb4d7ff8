"""Every fault in the middle of a run, at every reply latency: the tool never stands still under an open beam.

What really happened is read from the emulated controller's own trace.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from ibfctl_simulator.galil.clock import ScaledClock
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.inprocess import EmulatorServer
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.trace import TraceWriter
from support.plans import plan_of
from support.programs import SAMPLE_S, connected, machine

from ibfctl.machine.program import AxisProgram, PvtProgram
from ibfctl.runs.conductor import conduct
from ibfctl.runs.requests import Requests
from ibfctl.runs.result import RunResult
from ibfctl.runs.states import RunState
from ibfctl.runs.trace import RunTrace, read_emulator_trace

SPEED = 4.0
SEGMENT_SAMPLES = 60
SEGMENTS = {0.0: 340, 0.03: 340, 0.2: 300}
"""By latency: more than the buffer holds, but no more than 400 bytes a round trip can feed at this speed."""
SPEED_COUNTS_S = 8000
FAULT_AT = 0.15
LONGEST_STAND_S = 0.05
"""Of the controller: what a ramp to rest and the guard's next look may take."""

HALTED_WITH_THE_GUARD = {"abort input", "somebody else aborts"}
"""`AB` and the abort input halt the controller's programs as well: only the host, or the wiring, closes the gate."""

LATENCIES_S = [0.0, pytest.param(0.03, marks=pytest.mark.slow), pytest.param(0.2, marks=pytest.mark.slow)]


def steady_line(latency_s: float = 0.0) -> PvtProgram:
    """A line at one speed, so that a tool that stands still has been stopped."""
    segment_s = SEGMENT_SAMPLES * SAMPLE_S
    segments = SEGMENTS[latency_s]
    speed = np.full(segments, SPEED_COUNTS_S)
    speed[-1] = 0
    mean = (speed + np.concatenate([[0], speed[:-1]])) / 2
    axes = {}
    for letter, start, share in (("A", -80_000, 1.0), ("B", -10_000, 0.1)):
        moves = np.rint(share * mean * segment_s).astype(np.int64)
        axes[letter] = AxisProgram(moves, np.rint(share * speed).astype(np.int64), start, 1000.0)
    times = np.full(segments, SEGMENT_SAMPLES, dtype=np.int64)
    return PvtProgram(axes, {"x": "A", "y": "B"}, times, SAMPLE_S)


@dataclass
class Scene:
    """A run on the emulator, with something that happens on the way."""

    server: EmulatorServer
    requests: Requests
    happens: Callable[[Scene], None]
    happened: bool = False
    reports: list[tuple[str, Mapping[str, object]]] = field(default_factory=list)

    def __call__(self, kind: str, data: Mapping[str, object]) -> None:
        self.reports.append((kind, data))
        progress = data.get("progress") if kind == "progress" else None
        if not self.happened and isinstance(progress, float) and progress >= FAULT_AT:
            self.happened = True
            self.happens(self)

    def say(self, command: str) -> None:
        """Be another client, which sends one command."""
        with socket.create_connection((self.server.host, self.server.port), timeout=5) as other:
            other.sendall(f"{command}\r".encode())
            assert other.recv(64)


def play(happens: Callable[[Scene], None], latency_s: float, folder: Path) -> tuple[RunResult, RunTrace, Scene]:
    """Run until `happens`, and to the end that follows; then let time pass, to see what still moves."""
    writer = TraceWriter(folder / "trace.h5", "AB", SAMPLE_S)
    controller = Controller(Settings(axes=2), writer)
    with EmulatorServer(controller, ScaledClock(SPEED)) as server:
        bench = machine(port=server.port, timeout_s=1.0 + 3 * latency_s)
        scene = Scene(server, Requests(), happens)
        with connected(bench) as link:
            if latency_s:
                server.fault(f"delay seconds={latency_s:g}")
            result = conduct(plan_of(steady_line(latency_s)), bench, link, scene.requests, scene, time_scale=SPEED)
        server.fault("clear")
        server.call(lambda: controller.advance(round(20 / SAMPLE_S)))
        assert not controller.state.outputs & 1, "the gate is open"
    writer.close()
    return result, read_emulator_trace(folder / "trace.h5", bench), scene


def longest_stand_s(trace: RunTrace) -> float:
    """Longest time without motion behind an open gate."""
    moved = np.zeros(trace.sample.size, dtype=bool)
    for counts in trace.position_counts.values():
        moved[1:] |= np.diff(counts) != 0
    longest = standing = 0
    for stands in trace.gate_open & ~moved:
        standing = standing + 1 if stands else 0
        longest = max(longest, standing)
    return longest * trace.sample_period_s


def exposed_samples(trace: RunTrace) -> int:
    return int(trace.gate_open.sum())


def fault(line: str) -> Callable[[Scene], None]:
    return lambda scene: scene.server.fault(line)


FAULTS: dict[str, tuple[Callable[[Scene], None], set[RunState]]] = {
    "cable pulled": (fault("half-open"), {RunState.FAULTED}),
    "half-open stream": (fault("half-open handle=A"), {RunState.FAULTED}),
    "half-open status": (fault("half-open handle=B"), {RunState.FAULTED}),
    "half-open gate": (fault("half-open handle=C"), {RunState.FAULTED}),
    "handles lost": (fault("reset"), {RunState.FAULTED}),
    "late reply": (fault("stale handle=B"), {RunState.FAULTED}),
    "reply lost": (fault("drop handle=B"), {RunState.FAULTED}),
    "refused segment": (fault("refuse-pv at=7"), {RunState.FAULTED}),
    "axes diverge": (fault("skew axis=B"), {RunState.FAULTED}),
    "hard limit": (fault("limit axis=A side=forward"), {RunState.FAULTED}),
    "soft limit": (lambda scene: scene.say("FLA=-60000"), {RunState.FAULTED}),
    "following error": (fault("position-error axis=A counts=50000"), {RunState.FAULTED}),
    "encoder failure": (fault("encoder axis=A"), {RunState.FAULTED}),
    "hardware e-stop": (fault("e-stop"), {RunState.ESTOPPED}),
    "abort input": (fault("abort-input"), {RunState.ESTOPPED}),
    "somebody else stops": (lambda scene: scene.say("STA"), {RunState.FAULTED}),
    "somebody else aborts": (lambda scene: scene.say("AB"), {RunState.FAULTED}),
    "power cycled": (fault("power-cycle"), {RunState.FAULTED}),
    "host stalls": (lambda scene: time.sleep(4.0), {RunState.FAULTED}),
    "stop": (lambda scene: scene.requests.stop(), {RunState.STOPPED}),
    "abort": (lambda scene: scene.requests.abort.set(), {RunState.ABORTED}),
    "e-stop": (lambda scene: scene.requests.estop(), {RunState.ESTOPPED}),
}


@pytest.mark.parametrize("latency_s", LATENCIES_S)
@pytest.mark.parametrize("name", FAULTS)
def test_no_fault_drills_a_hole(name: str, latency_s: float, tmp_path: Path) -> None:
    happens, ends = FAULTS[name]
    result, trace, scene = play(happens, latency_s, tmp_path)
    assert scene.happened
    assert result.state in ends
    host_s = SPEED * (0.15 + 4 * latency_s) if name in HALTED_WITH_THE_GUARD else 0.0
    assert longest_stand_s(trace) <= LONGEST_STAND_S + host_s
    # The record is what happened, and claims no more than is known.
    claimed = sum(last - first for first, last in result.executed_plan_samples)
    assert claimed < steady_line(latency_s).time_samples.sum(), "noticed at the end alone"
    assert claimed - 4 <= exposed_samples(trace) <= claimed + result.uncertainty_samples + 4
    assert result.error is not None
    assert result.error.hint or result.state is not RunState.FAULTED
    told = [data for kind, data in scene.reports if kind == "state"][-1]
    assert told["reason"] == result.error.message
    place = told["place"]
    assert isinstance(place, Mapping)
    assert place["plan_sample"] >= FAULT_AT * steady_line(latency_s).time_samples.sum() * 0.9


@pytest.mark.parametrize("latency_s", LATENCIES_S)
def test_without_a_fault_all_is_exposed(latency_s: float, tmp_path: Path) -> None:
    result, trace, _ = play(lambda scene: None, latency_s, tmp_path)
    assert result.state is RunState.COMPLETED, result.error
    assert abs(exposed_samples(trace) - steady_line(latency_s).time_samples.sum()) <= 2
    assert longest_stand_s(trace) <= LONGEST_STAND_S


def test_a_clock_on_the_wall_that_jumps_is_no_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = time.time
    result, _, _ = play(lambda scene: monkeypatch.setattr(time, "time", lambda: real() + 86_400), 0.0, tmp_path)
    assert result.state is RunState.COMPLETED, result.error


def test_a_sample_that_lasts_too_long_moves_nothing(tmp_path: Path) -> None:
    with EmulatorServer(Controller(Settings(axes=2)), ScaledClock(SPEED)) as server:
        server.fault("sample-time scale=1.024")
        bench = machine(port=server.port)
        with connected(bench) as link:
            result = conduct(plan_of(steady_line()), bench, link, Requests(), time_scale=SPEED)
        assert result.state is RunState.FAULTED
        assert "sample" in str(result.error)
        assert [axis.motor_on for axis in server.controller.state.axes] == [False, False]


def test_a_gate_left_open_by_somebody_is_closed_before_anything_moves(tmp_path: Path) -> None:
    with EmulatorServer(Controller(Settings(axes=2)), ScaledClock(SPEED)) as server:
        bench = machine(port=server.port)
        with connected(bench) as link:
            Scene(server, Requests(), lambda scene: None).say("SB 1")
            result = conduct(plan_of(steady_line()), bench, link, Requests(), time_scale=SPEED, resume_at=None)
        assert not server.call(lambda: server.controller.state.outputs & 1)
    assert result.state is RunState.COMPLETED
