"""Workers killed at random moments: what recovery says was executed, against the emulated controller's own trace."""

from __future__ import annotations

import os
import random
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.file import write_plan
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import Plan
from ibfctl.planning.planner import make_plan
from ibfctl.runs.adoption import interrupt_orphans
from ibfctl.runs.emulator import EmulatedController, emulated_controller
from ibfctl.runs.job import Address, Job, prepare
from ibfctl.runs.launch import start_worker
from ibfctl.runs.records import as_run_of
from ibfctl.runs.recovery import Recovered, recover
from ibfctl.runs.run_file import read_as_run
from ibfctl.runs.states import RunState
from ibfctl.runs.status import read
from ibfctl.runs.trace import RunTrace, read_emulator_trace
from ibfctl.surface.influence import gaussian
from ibfctl.surface.levelling import rms
from ibfctl.surface.map import SurfaceMap

TRIALS = 200
BATCH = 20
SPEED = 30.0
SHARE_WHILE_MOVING = 0.8
START_S = 3.0
RECOVER_AFTER_S = (0.0, 0.3, 3.0)
LOOK_S = 0.005
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


class Machine:
    """An emulated controller, and the data folder of the runs on it."""

    def __init__(self, data: Path, emulated: EmulatedController, plan: Path) -> None:
        self._data = data
        self._plan = plan
        self.emulated = emulated
        self._trials = 0

    def killed(self, after_s: float, recover_after_s: float, *, once_moving: bool) -> Trial:
        """Start a run, kill its worker `after_s` from its start, or from when the axes begin to move; recover."""
        self._trials += 1
        address = Address(host=self.emulated.host, port=self.emulated.port)
        job = Job(run=f"r{self._trials:04d}", simulated=True, speed=self.emulated.time_scale, address=address)
        folder = prepare(self._data, job, self._plan, shipped_machine("simulator"))
        with start_worker(folder) as worker:
            while once_moving and worker.poll() is None and (read(folder) or {}).get("state") != RunState.RUNNING:
                time.sleep(LOOK_S)
            time.sleep(after_s)
            os.kill(worker.pid, signal.SIGKILL)
        time.sleep(recover_after_s)
        interrupt_orphans(self._data)
        return Trial(folder, after_s, recover(folder))


def judge(plan: Plan, trials: list[Trial], trace: RunTrace) -> list[Verdict]:
    """Compare all trials on one controller, in their order, with its trace."""
    sample = trace.sample[trace.gate_open]
    exposures = np.split(np.flatnonzero(trace.gate_open), np.flatnonzero(np.diff(sample) > 1) + 1)
    begun = [trial for trial in trials if trial.said_samples]
    if sum(part.size > 0 for part in exposures) != len(begun):
        raise RuntimeError(f"the gate was open {len(exposures)} times, {len(begun)} are known")
    verdicts = [Verdict(trial, 0, 0.0) for trial in trials if not trial.said_samples]
    for trial, rows in zip(begun, exposures, strict=True):
        true = as_run_of(plan, part_of(trace, rows))
        said = read_as_run(trial.folder / "run.h5")
        assert true is not None
        assert said is not None
        verdicts.append(Verdict(trial, rows.size, rms(said.removal_nm - true.removal_nm)))
    return verdicts


def part_of(trace: RunTrace, rows: np.ndarray) -> RunTrace:
    """Return some rows of a trace."""
    positions = {letter: counts[rows] for letter, counts in trace.position_counts.items()}
    return RunTrace(trace.sample[rows], positions, trace.gate_open[rows], trace.sample_period_s)


def try_out(trials: int, seed: int, speed: float = SPEED) -> list[Verdict]:
    """Kill that many workers at random moments, one after the other on one controller."""
    chance = random.Random(seed)
    plan = small_plan()
    motion_s = plan.program.total_time_s / speed
    with tempfile.TemporaryDirectory(prefix="ibfctl-") as name:
        data = Path(name)
        write_plan(plan, data / "plan.h5")
        with emulated_controller(data / "trace.h5", speed=speed) as emulated:
            machine = Machine(data, emulated, data / "plan.h5")
            done = []
            for _ in range(trials):
                moving = chance.random() < SHARE_WHILE_MOVING
                after_s = chance.uniform(0.0, 1.1 * motion_s if moving else START_S)
                done.append(machine.killed(after_s, chance.choice(RECOVER_AFTER_S), once_moving=moving))
        return judge(plan, done, read_emulator_trace(data / "trace.h5", plan.machine))


def run() -> dict[str, Any]:
    """Kill 200 workers."""
    verdicts: list[Verdict] = []
    for batch in range(TRIALS // BATCH):
        verdicts += try_out(BATCH, seed=batch)
        print(f"{sum(verdict.right for verdict in verdicts)} of {len(verdicts)}", file=sys.stderr)
    exposed = [verdict for verdict in verdicts if verdict.true_samples]
    return {
        "metrics": {
            "trials": len(verdicts),
            "recovered": sum(verdict.right for verdict in verdicts),
            "killed_while_exposed": len(exposed),
            "largest_count_error": max(abs(v.trial.said_samples - v.true_samples) for v in verdicts),
            "largest_removal_error_nm": max(v.removal_error_nm for v in verdicts),
        },
        "targets": {"recovered": {"min": TRIALS}},
    }
