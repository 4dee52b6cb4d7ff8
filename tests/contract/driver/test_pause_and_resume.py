"""A run that pauses and resumes removes what the plan does: the gate is open once at every sample of the plan."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from support.cubics import cubic_counts
from support.programs import connected, machine, program

from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import PvtProgram
from ibfctl.runs.emulator import emulated_controller
from ibfctl.runs.leg import Leg, LegEnd, LegOutcome
from ibfctl.runs.motion import execute_leg
from ibfctl.runs.outcome import RunProgress
from ibfctl.runs.requests import Requests, When
from ibfctl.runs.rig import Rig
from ibfctl.runs.sentinel import Sentinel
from ibfctl.runs.trace import RunTrace, read_emulator_trace

SPEED = 20.0
JOB = program(700)


@contextmanager
def a_rig(bench: MachineDescription, speed: float = SPEED) -> Iterator[Rig]:
    requests = Requests()
    with connected(bench) as controller, Sentinel(controller, requests) as sentinel:
        rig = Rig(bench, controller, requests, sentinel, speed)
        rig.close_gate_timed()
        yield rig


def executed_once_at(executed: int, act: Callable[[], None]) -> Callable[[RunProgress], None]:
    def look(progress: RunProgress) -> None:
        if progress.executed >= executed:
            act()

    return look


def exposures(trace: RunTrace) -> list[np.ndarray]:
    """Rows of each time the gate was open."""
    rows = np.flatnonzero(trace.gate_open)
    return np.split(rows, np.flatnonzero(np.diff(trace.sample[rows]) != 1) + 1)


def assert_exposed(job: PvtProgram, trace: RunTrace, outcomes: list[LegOutcome]) -> None:
    """Each exposure lies on the plan's cubics at the place that its leg states."""
    analytic = {letter: cubic_counts(job, letter) for letter in "AB"}
    for rows, outcome in zip(exposures(trace), outcomes, strict=True):
        assert outcome.open_plan_samples is not None
        opened, closed = outcome.open_plan_samples
        assert rows.size == closed - opened
        for letter in "AB":
            off = trace.position_counts[letter][rows] - analytic[letter][opened:closed]
            assert np.max(np.abs(off)) <= 1.0 + 1e-6


@pytest.mark.parametrize("when", list(When))
def test_a_pause_and_a_resume_leave_neither_gap_nor_overlap(when: When, tmp_path: Path) -> None:
    with emulated_controller(tmp_path / "trace.h5", speed=SPEED) as emulated:
        bench = emulated.in_place_of(machine())
        with a_rig(bench) as rig:
            pausing = executed_once_at(200, lambda: rig.requests.pause(when))
            first = execute_leg(Leg(JOB), rig, on_progress=pausing)
            rig.requests.resume()
            assert first.open_plan_samples is not None
            second = execute_leg(Leg.resumed(JOB, first.open_plan_samples[1], bench), rig)
    assert (first.end, second.end) == (LegEnd.PAUSED, LegEnd.COMPLETED)
    assert second.open_plan_samples is not None
    assert abs(second.open_plan_samples[0] - first.open_plan_samples[1]) <= 1
    assert second.open_plan_samples[1] == JOB.time_samples.sum()
    assert_exposed(JOB, read_emulator_trace(tmp_path / "trace.h5", bench), [first, second])
