"""Runs whose worker or service is killed, and what is known of them afterwards against the emulator's own trace."""

from __future__ import annotations

import contextlib
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from ibfctl.client import Client
from ibfctl.errors import RunError
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.file import read_plan, write_plan
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import Plan
from ibfctl.planning.planner import make_plan
from ibfctl.runs.adoption import has_worker, interrupt_orphans
from ibfctl.runs.control import send
from ibfctl.runs.detached_emulator import DetachedEmulator
from ibfctl.runs.emulator import EmulatedController
from ibfctl.runs.job import Address, Job, prepare
from ibfctl.runs.launch import start_worker
from ibfctl.runs.places import run_folder
from ibfctl.runs.records import as_run_of
from ibfctl.runs.recovery import Recovered, recover
from ibfctl.runs.run_file import read_as_run
from ibfctl.runs.states import RunState
from ibfctl.runs.status import read
from ibfctl.runs.trace import RunTrace, read_emulator_trace
from ibfctl.surface.influence import gaussian
from ibfctl.surface.levelling import rms
from ibfctl.surface.map import SurfaceMap

SPEED = 30.0
MOTION_S = 90.0
TIF = "gaussian:fwhm_mm=1.6,peak_nm_s=4,radius_mm=2"
SHARE_WHILE_MOVING, SHARE_PAUSED, SHARE_OF_BOTH = 0.8, 0.25, 0.5
START_S = 3.0
RECOVER_AFTER_S = (0.0, 0.3, 3.0)
LOOK_S = 0.005
PATIENCE_S = 1.0  # shorter than the motion lasts here, so that the guard has its part too
COUNT_TOLERANCE_SAMPLES = 1
REMOVAL_TOLERANCE_NM = 0.02


@dataclass(frozen=True)
class Trial:
    """One run whose worker was killed, and what recovery has found."""

    folder: Path
    killed_after_s: float
    found: Recovered

    @property
    def said_samples(self) -> int:
        """Samples that were executed with the gate open, as recovery says."""
        return sum(last - first for first, last in self.found.executed)


@dataclass(frozen=True)
class Verdict:
    """What recovery said against what the trace says: samples with the gate open, and RMS of the removal."""

    trial: Trial
    true_samples: int
    removal_error_nm: float

    @property
    def right(self) -> bool:
        """Whether both agree."""
        counts = abs(self.trial.said_samples - self.true_samples) <= COUNT_TOLERANCE_SAMPLES
        return counts and self.trial.found.uncertainty_samples == 0 and self.removal_error_nm <= REMOVAL_TOLERANCE_NM


def small_plan() -> Plan:
    """Plan a part of 12 x 8 mm, some 90 s of motion."""
    y, x = np.mgrid[-1:1:32j, -1:1:48j]
    surface = SurfaceMap.centred(8 * x**2 + 5 * y**2 * x + 2 * np.cos(5 * x), 0.25)
    tool = gaussian(1.6, 4.0, 2.0, 0.1)
    options = PlanOptions(pitch_mm=1.0, step_mm=1.0)
    return make_plan(surface, tool, read_machine(shipped_machine("simulator")), options)


def killed_alone(data: Path, emulated: EmulatedController, number: int, chance: random.Random) -> Trial:
    """Start a run without a service, kill its worker, and recover."""
    folder = waiting_run(data, emulated, f"r{number:04d}")
    with start_worker(folder) as worker:
        after_s = _wait(folder, chance, emulated.time_scale, worker.poll)
        worker.kill()
    time.sleep(chance.choice(RECOVER_AFTER_S))
    interrupt_orphans(data)
    return Trial(folder, after_s, recover(folder))


def write_inputs(plan: Plan, data: Path) -> None:
    """Write plan and machine file into a data folder."""
    write_plan(plan, data / "plan.h5")
    text = shipped_machine("simulator").read_text(encoding="utf-8")
    (data / "machine.toml").write_text(re.sub("guard_patience_s = .*", f"guard_patience_s = {PATIENCE_S}", text))


def waiting_run(data: Path, emulated: EmulatedController, run: str) -> Path:
    """Make the folder of a run of the plan in a data folder."""
    address = Address(host=emulated.host, port=emulated.port)
    job = Job(run=run, simulated=True, speed=emulated.time_scale, address=address)
    return prepare(data, job, data / "plan.h5", data / "machine.toml")


def killed_served(data: Path, service: Service, chance: random.Random) -> Trial:
    """Start a run over REST, kill the service and perhaps the worker too, start a new service, and recover."""
    run = service.client.runs.start(service.plan_id)["id"]
    folder = run_folder(data, run)
    after_s = _wait(folder, chance, service.speed, lambda: None)
    service.kill()
    worker_too = chance.random() < SHARE_OF_BOTH
    if worker_too and has_worker(folder):
        with contextlib.suppress(ProcessLookupError, KeyError):
            os.kill((read(folder) or {})["worker_pid"], signal.SIGKILL)
    service.start()
    while service.client.info()["running"]:
        time.sleep(LOOK_S)
    ended = service.client.runs.show(run)
    if not worker_too and RunState(ended["state"]) is not RunState.COMPLETED:
        raise RuntimeError(f"run {run} did not survive the service: {ended}")
    return Trial(folder, after_s, recover(folder))


def _wait(folder: Path, chance: random.Random, speed: float, over: Callable[[], int | None]) -> float:
    """Wait for a random moment of a run's start or of its motion; some runs are paused and resumed on the way."""
    moving = chance.random() < SHARE_WHILE_MOVING
    after_s = chance.uniform(0.0, MOTION_S / speed if moving else START_S)
    while moving and over() is None and (read(folder) or {}).get("state") != RunState.RUNNING:
        time.sleep(LOOK_S)
    if moving and chance.random() < SHARE_PAUSED:
        with contextlib.suppress(RunError):
            time.sleep(chance.uniform(0.0, 0.3 * after_s))
            send(folder, {"act": "pause", "when": chance.choice(["now", "safe-point"])})
            time.sleep(chance.uniform(0.0, 0.5))
            send(folder, {"act": "resume"})
    time.sleep(after_s)
    return after_s


def judge(plan: Plan, trials: Sequence[Trial], trace: RunTrace) -> list[Verdict]:
    """Compare all trials on one controller, in their order, with its trace."""
    rows = np.flatnonzero(trace.gate_open)
    exposures = iter(np.split(rows, np.flatnonzero(np.diff(trace.sample[rows]) > 1) + 1) if rows.size else [])
    verdicts = []
    for trial in trials:
        parts = [next(exposures) for first, last in trial.found.executed if last > first]
        if not parts:
            verdicts.append(Verdict(trial, 0, 0.0))
            continue
        true, said = as_run_of(plan, part_of(trace, np.concatenate(parts))), read_as_run(trial.folder / "run.h5")
        assert true is not None
        assert said is not None
        count = sum(part.size for part in parts)
        verdicts.append(Verdict(trial, count, rms(said.removal_nm - true.removal_nm)))
    if any(True for _ in exposures):
        raise RuntimeError("the gate was open more often than is known")
    return verdicts


def part_of(trace: RunTrace, rows: np.ndarray) -> RunTrace:
    """Return some rows of a trace."""
    positions = {letter: counts[rows] for letter, counts in trace.position_counts.items()}
    return RunTrace(trace.sample[rows], positions, trace.gate_open[rows], trace.sample_period_s)


def try_out(trials: int, seed: int, *, served: bool, speed: float = SPEED) -> list[Verdict]:
    """Kill that many times at random moments, one run after the other on one controller."""
    chance = random.Random(seed)
    plan = small_plan()
    with tempfile.TemporaryDirectory(prefix="ibfctl-") as name:
        data = Path(name)
        write_inputs(plan, data)
        emulator = DetachedEmulator.start_or_adopt(data, speed=speed, trace=data / "trace.h5")
        try:
            done = []
            if served:
                with Service(data, speed) as service:
                    plan = service.make_plan(plan)
                    done = [killed_served(data, service, chance) for _ in range(trials)]
            else:
                done = [killed_alone(data, emulator.controller, number, chance) for number in range(trials)]
        finally:
            emulator.end()
        return judge(plan, done, read_emulator_trace(data / "trace.h5", plan.machine))


class Service:
    """`ibfctl serve --simulate` as a process, on the emulated controller that the data folder has."""

    def __init__(self, data: Path, speed: float) -> None:
        self._data = data
        self.speed = speed
        self.plan_id = ""
        self.start()

    def start(self) -> None:
        """Start it and wait until it listens."""
        command = [sys.executable, "-m", "ibfctl", "serve", "--simulate", "--port", "0"]
        command += [
            "--data",
            str(self._data),
            "--speed",
            f"{self.speed:g}",
            "--machine",
            str(self._data / "machine.toml"),
        ]
        self._process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
        assert self._process.stderr is not None
        self.client = Client(self._process.stderr.readline().split()[2].rstrip(","))

    def kill(self) -> None:
        """Kill it; whatever it has started goes on."""
        self.client.close()
        self._process.kill()
        self._process.communicate()

    def make_plan(self, like: Plan) -> Plan:
        """Have the service plan the same job, and return its plan."""
        assert like.surface is not None
        path = self._data / "map.npz"
        np.savez(path, height_nm=like.surface.height_nm, pixel_mm=like.surface.pixel_mm)
        client = self.client
        surface, influence = client.maps.add(path)["id"], client.influences.add(TIF, pixel_mm=0.1)["id"]
        self.plan_id = client.plans.create(surface, influence, pitch_mm=1.0, step_mm=1.0)["id"]
        client.plans.wait(self.plan_id)
        return read_plan(self._data / "plans" / self.plan_id / "plan.h5")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.returncode is None:
            self.kill()
