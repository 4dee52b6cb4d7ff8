"""Whole runs of a real plan against the emulated controller, by what its own trace says."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from ibfctl_simulator.galil.clock import ScaledClock
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.inprocess import EmulatorServer
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.trace import TraceWriter
from support.plans import plan_of
from support.programs import connected, machine, program
from support.small_job import small_height_nm

from ibfctl.machine.description import Interlock, MachineDescription, read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.as_run import as_run_figures
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import Plan
from ibfctl.planning.planner import make_plan
from ibfctl.runs.conductor import conduct
from ibfctl.runs.emulator import emulated_controller
from ibfctl.runs.requests import Requests, When
from ibfctl.runs.result import RunResult
from ibfctl.runs.states import TERMINAL, RunState, check
from ibfctl.runs.trace import RunTrace, read_emulator_trace
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import SurfaceMap

SPEED = 20.0
SEAM_RMS_NM = 0.02
AS_RUN_RMS_NM = 0.001


@dataclass
class Listener:
    """Checks every state, keeps all reports, and acts once on what it is told to wait for."""

    act_at: float | None = None
    act: Callable[[], None] = lambda: None
    state: RunState = RunState.PREFLIGHT
    reports: list[tuple[str, Mapping[str, object]]] = field(default_factory=list)
    paused: threading.Event = field(default_factory=threading.Event)
    ended: threading.Event = field(default_factory=threading.Event)

    def __call__(self, kind: str, data: Mapping[str, object]) -> None:
        self.reports.append((kind, data))
        if kind == "state":
            new = RunState(str(data["state"]))
            check(self.state, new)
            self.state = new
            if new is RunState.PAUSED or new in TERMINAL:
                self.paused.set()
            if new in TERMINAL:
                self.ended.set()
        progress = data.get("progress") if kind == "progress" else None
        if self.act_at is not None and isinstance(progress, float) and progress >= self.act_at:
            self.act_at = None
            self.act()

    def states(self) -> list[str]:
        return [str(data["state"]) for kind, data in self.reports if kind == "state"]

    def of(self, kind: str) -> list[Mapping[str, object]]:
        return [data for name, data in self.reports if name == kind]


@contextmanager
def resuming_when_paused(listener: Listener, requests: Requests) -> Iterator[None]:
    def resume() -> None:
        assert listener.paused.wait(60)
        requests.resume()

    thread = threading.Thread(target=resume)
    thread.start()
    yield
    thread.join()


@pytest.fixture(scope="module")
def real_plan() -> Plan:
    surface = SurfaceMap(small_height_nm(), 0.25, -6.0, -4.0)
    options = PlanOptions(pitch_mm=1.0, step_mm=1.0)
    return make_plan(surface, gaussian(1.6, 4.0, 2.0, 0.25), read_machine(shipped_machine("simulator")), options)


def removal_nm(plan: Plan, trace: RunTrace) -> np.ndarray:
    position = {
        coordinate: trace.position_counts[letter][trace.gate_open] / plan.program.axes[letter].counts_per_mm
        for coordinate, letter in plan.program.coordinates.items()
    }
    return as_run_figures(plan, position["x"], position["y"], trace.sample_period_s).removal_nm


def rms_over_aperture(plan: Plan, difference_nm: np.ndarray) -> float:
    assert plan.prediction is not None
    return float(np.sqrt(np.mean(difference_nm[plan.prediction.clear_aperture] ** 2)))


def run_with_a_pause(
    plan: Plan, when: When, trace: Path, faults: tuple[str, ...], speed: float, patience_s: float
) -> RunResult:
    requests = Requests()
    listener = Listener(0.3, lambda: requests.pause(when))
    with emulated_controller(trace, speed=speed, faults=faults) as emulated:
        gate = plan.machine.beam_gate.model_copy(update={"guard_patience_s": patience_s})
        bench = emulated.in_place_of(plan.machine).model_copy(update={"beam_gate": gate})
        with connected(bench) as controller, resuming_when_paused(listener, requests):
            return conduct(plan, bench, controller, requests, listener, time_scale=speed)


@pytest.mark.parametrize(
    ("when", "faults", "speed", "patience_s"),
    [  # slow enough that not all is sent at once
        (When.SAFE_POINT, (), 4.0, 0.5),
        (When.NOW, (), 4.0, 0.5),
        pytest.param(When.SAFE_POINT, ("delay seconds=0.2",), 2.0, 2.0, marks=pytest.mark.slow),
        pytest.param(When.NOW, ("delay seconds=0.2",), 2.0, 2.0, marks=pytest.mark.slow),
    ],
)
def test_the_dose_over_a_seam_is_the_plans(
    real_plan: Plan, when: When, faults: tuple[str, ...], speed: float, patience_s: float, tmp_path: Path
) -> None:
    result = run_with_a_pause(real_plan, when, tmp_path / "trace.h5", faults, speed, patience_s)
    assert (result.error, result.state, len(result.legs)) == (None, RunState.COMPLETED, 2)
    assert result.trace is not None
    assert real_plan.prediction is not None
    truth_nm = removal_nm(real_plan, read_emulator_trace(tmp_path / "trace.h5", real_plan.machine))
    assert rms_over_aperture(real_plan, truth_nm - real_plan.prediction.executed_removal_nm) < SEAM_RMS_NM
    assert rms_over_aperture(real_plan, truth_nm - removal_nm(real_plan, result.trace)) < AS_RUN_RMS_NM


def test_a_run_reports_all_that_an_operator_wants_to_know(real_plan: Plan) -> None:
    listener = Listener()
    with emulated_controller(None, speed=SPEED) as emulated:
        bench = emulated.in_place_of(real_plan.machine)
        with connected(bench) as controller:
            result = conduct(real_plan, bench, controller, Requests(), listener, time_scale=SPEED)
    assert result.error is None
    assert listener.states() == ["moving_to_start", "armed", "running", "finishing", "completed"]
    assert all(item["ok"] for item in listener.of("preflight")[0]["checks"])  # type: ignore[attr-defined]
    first, *_, last = [data for data in listener.of("progress") if "place" in data]
    assert first["progress"] < last["progress"] == 1.0  # type: ignore[operator]
    assert last["residual_rms_nm"] == pytest.approx(real_plan.summary()["executed_rms_nm"], rel=0.02)
    assert first["residual_rms_nm"] > 10 * last["residual_rms_nm"]  # type: ignore[operator]
    assert last["gate"] == "closed"
    assert abs(result.duration.as_run_s - result.duration.planned_s) <= result.duration.resolution_s + 0.1
    assert listener.of("fault") == []


@contextmanager
def emulator(settings: Settings | None = None) -> Iterator[EmulatorServer]:
    with EmulatorServer(Controller(settings or Settings(axes=2)), ScaledClock(SPEED)) as server:
        yield server


def bench_of(server: EmulatorServer, **changes: object) -> MachineDescription:
    return machine(port=server.port).model_copy(update=changes)


def run_on(server: EmulatorServer, requests: Requests, listener: Listener, **changes: object) -> RunResult:
    bench = bench_of(server, **changes)
    with connected(bench) as controller:
        return conduct(plan_of(program(700)), bench, controller, requests, listener, time_scale=SPEED)


def gate_is_open(server: EmulatorServer) -> bool:
    return bool(server.call(lambda: server.controller.state.outputs & 1))


@pytest.mark.parametrize(
    ("act", "state", "codes"),
    [
        (Requests.stop, RunState.STOPPED, {4}),
        (lambda requests: requests.abort.set(), RunState.ABORTED, {7}),
        (Requests.estop, RunState.ESTOPPED, {4, 7}),
    ],
)
def test_stop_abort_and_emergency_stop_are_three_ends(
    act: Callable[[Requests], None], state: RunState, codes: set[int]
) -> None:
    requests = Requests()
    listener = Listener(0.2, lambda: act(requests))
    with emulator() as server:
        result = run_on(server, requests, listener)
        assert result.state is listener.state is state
        assert not gate_is_open(server)
        axes = server.controller.state.axes
        assert {axis.stop_code for axis in axes} <= codes
        assert [axis.motor_on for axis in axes] == [state is not RunState.ESTOPPED] * 2
        standing = [axis.encoder_counts for axis in axes]
        server.call(lambda: server.controller.advance(2048))
        assert standing == [axis.encoder_counts for axis in axes]
    assert result.executed_plan_samples[0][1] < 0.5 * program(700).time_samples.sum()
    assert result.uncertainty_samples == 0


def test_an_emergency_stop_stays_latched_until_power_is_cycled() -> None:
    requests = Requests()
    with emulator() as server:
        run_on(server, requests, Listener(0.1, requests.estop))
        listener = Listener()
        again = run_on(server, Requests(), listener)
        assert again.state is RunState.FAULTED
        assert "emergency stop" in str(again.error)
        server.fault("power-cycle")
        assert run_on(server, Requests(), Listener()).state is RunState.COMPLETED


def test_an_axis_that_was_not_homed_does_not_move() -> None:
    homing = machine().homing.model_copy(update={"method": "switch"})
    with emulator() as server:
        listener = Listener()
        result = run_on(server, Requests(), listener, homing=homing)
        assert result.state is RunState.FAULTED
        assert "homed" in str(result.error)
        assert [axis.motor_on for axis in server.controller.state.axes] == [False, False]
    assert [item["name"] for item in listener.of("preflight")[0]["checks"] if not item["ok"]] == ["homed"]  # type: ignore[attr-defined]


def test_soft_limits_on_the_controller_are_respected() -> None:
    with emulator() as server:
        server.call(lambda: server.controller.state.axes[0].parameters.__setitem__("FL", 1000.0))
        result = run_on(server, Requests(), Listener())
    assert result.state is RunState.FAULTED
    assert "soft limits" in str(result.error)


def test_somebody_elses_run_is_left_alone() -> None:
    first, second = Requests(), Listener()
    with emulator() as server:
        outcome: list[RunResult] = []
        listener = Listener(0.1, lambda: outcome.append(run_on(server, Requests(), second)))
        assert run_on(server, first, listener).state is RunState.COMPLETED
    assert outcome[0].state is RunState.FAULTED
    assert [item["name"] for item in second.of("preflight")[0]["checks"]] == ["alone"]  # type: ignore[attr-defined]


def test_an_interlock_pauses_the_run_and_lets_it_go_on_once_settled() -> None:
    vacuum = Interlock(name="vacuum", source="digital 3", min=1, max=1, settle_s=0.1)
    with emulator() as server:
        listener = Listener(0.2, lambda: server.fault("input number=3 level=0"))

        def mend() -> None:
            assert listener.paused.wait(60)
            assert not gate_is_open(server)
            server.fault("input number=3 level=1")

        mending = threading.Thread(target=mend)
        mending.start()
        result = run_on(server, Requests(), listener, interlocks=(vacuum,))
        mending.join()
    assert result.state is RunState.COMPLETED
    assert len(result.legs) == 2
    assert [data["ok"] for data in listener.of("interlock")] == [False, True]


def test_a_pushed_value_that_never_came_lets_nothing_begin() -> None:
    current = Interlock(name="beam current", source="pushed", min=4, max=6)
    with emulator() as server:
        result = run_on(server, Requests(), Listener(), interlocks=(current,))
        assert "beam current" in str(result.error)
        requests = Requests()
        requests.interlock("beam current", 5.0)
        assert run_on(server, requests, Listener(), interlocks=(current,)).state is RunState.COMPLETED


def test_a_controller_that_loses_its_power_while_paused_interrupts_the_run() -> None:
    requests = Requests()
    with emulator() as server:
        listener = Listener(0.2, lambda: requests.pause(When.NOW))

        def cut() -> None:
            assert listener.paused.wait(60)
            server.fault("power-cycle")

        cutting = threading.Thread(target=cut)
        cutting.start()
        result = run_on(server, requests, listener)
        cutting.join()
        assert not gate_is_open(server)
    assert result.state is RunState.INTERRUPTED
    assert listener.of("fault")[0]["hint"]
    assert result.legs[0].seam == result.executed_plan_samples[0][1]


def test_an_interrupted_run_is_taken_up_at_its_seam() -> None:
    requests = Requests()
    with emulator() as server:
        stopped = run_on(server, requests, Listener(0.3, requests.stop))
        seam = stopped.legs[-1].seam
        listener = Listener(state=RunState.RESUMING)
        bench = bench_of(server)
        with connected(bench) as controller:
            rest = conduct(
                plan_of(program(700)), bench, controller, Requests(), listener, time_scale=SPEED, resume_at=seam
            )
    assert rest.state is RunState.COMPLETED
    assert abs(rest.executed_plan_samples[0][0] - seam) <= 1


@pytest.mark.parametrize(("segments", "time_samples", "seed"), [(700, 60, 1), (60, 2000, 2), (120, 300, 3)])
def test_however_often_somebody_pauses_the_plan_is_executed_once(segments: int, time_samples: int, seed: int) -> None:
    random, job = np.random.default_rng(seed), program(segments, time_samples)
    requests, listener = Requests(), Listener()

    def meddle() -> None:
        while not listener.ended.wait(random.uniform(0, 0.3)):
            requests.pause(list(When)[random.integers(2)])
            listener.ended.wait(random.uniform(0, 0.2))
            requests.resume()

    with emulator() as server:
        meddling = threading.Thread(target=meddle)
        meddling.start()
        gate = machine().beam_gate.model_copy(update={"guard_patience_s": 0.5})
        bench = bench_of(server, beam_gate=gate)
        with connected(bench) as controller:
            result = conduct(plan_of(job), bench, controller, requests, listener, time_scale=SPEED)
        listener.ended.set()
        meddling.join()
    assert result.state is RunState.COMPLETED, result.error
    assert len(result.legs) > 1
    parts = result.executed_plan_samples
    assert (parts[0][0], parts[-1][1]) == (0, job.time_samples.sum())
    assert all(abs(after[0] - before[1]) <= 2 for before, after in pairwise(parts))


def test_what_was_executed_is_known_though_the_program_fails() -> None:
    def fail() -> None:
        raise ZeroDivisionError("a defect")

    with emulator() as server:
        result = run_on(server, Requests(), Listener(0.2, fail))
        assert not gate_is_open(server)
    assert result.state is RunState.FAULTED
    assert "a defect" in str(result.error)
    assert result.uncertainty_samples == 0
    assert result.executed_plan_samples[0][1] > 0.2 * program(700).time_samples.sum()


def test_what_was_executed_is_bounded_where_the_controller_no_longer_answers(tmp_path: Path) -> None:
    trace = TraceWriter(tmp_path / "trace.h5", "AB", 1 / 1024)
    controller = Controller(Settings(axes=2), trace)
    with EmulatorServer(controller, ScaledClock(SPEED)) as server:
        listener = Listener(0.1, lambda: server.fault("half-open"))
        bench = bench_of(server)
        connection = bench.connection.model_copy(update={"timeout_s": 0.3})
        result = run_on(server, Requests(), listener, connection=connection)
        server.call(lambda: controller.advance(100 * 1024))
    trace.close()
    exposed = int(read_emulator_trace(tmp_path / "trace.h5", machine()).gate_open.sum())
    ((opened, closed),) = result.executed_plan_samples
    assert result.state is RunState.FAULTED
    assert "switch the beam off by hand" in str(result.error)
    assert result.uncertainty_samples > 0
    assert closed - opened <= exposed <= closed - opened + result.uncertainty_samples


@pytest.mark.parametrize("while_paused", [True, False])
def test_an_emergency_stop_of_the_machine_ends_the_run_as_one(while_paused: bool) -> None:
    requests = Requests()
    with emulator() as server:
        act = (lambda: requests.pause(When.NOW)) if while_paused else (lambda: server.fault("e-stop"))
        listener = Listener(0.2, act)

        def strike() -> None:
            assert listener.paused.wait(60)
            server.fault("e-stop")

        striking = threading.Thread(target=strike)
        striking.start()
        result = run_on(server, requests, listener)
        striking.join()
        assert not gate_is_open(server)
    assert result.state is RunState.ESTOPPED
    assert result.error is not None
    assert result.error.hint


def test_a_time_base_that_was_wrong_shows_in_the_duration() -> None:
    with emulator() as server:
        listener = Listener(0.05, lambda: server.fault("sample-time scale=1.02"))
        result = run_on(server, Requests(), listener)
    assert result.state is RunState.COMPLETED
    assert result.duration.as_run_s > 1.01 * result.duration.planned_s
    assert [fault["code"] for fault in listener.of("fault")] == ["time_base"]
