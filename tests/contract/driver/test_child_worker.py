"""The worker process as the service sees it: a job in, JSON lines out, an exit code."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.plans import plan_of
from support.programs import machine, program

from ibfctl.planning.file import write_plan
from ibfctl.runs.trace import read_emulator_trace

TIMEOUT_S = 60


@pytest.fixture
def plan_file(tmp_path: Path) -> Path:
    write_plan(plan_of(program(600)), tmp_path / "plan.h5")
    return tmp_path / "plan.h5"


def work(
    job: dict[str, object], and_then: Callable[[subprocess.Popen[str]], None] = lambda _: None
) -> tuple[int, list[dict[str, object]]]:
    command = [sys.executable, "-m", "ibfctl.runs.child_worker"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps(job) + "\n")
        process.stdin.flush()
        lines = []
        for line in process.stdout:
            lines.append(json.loads(line))
            if len(lines) == 1:
                and_then(process)
        return process.wait(TIMEOUT_S), lines


def test_a_run_reports_progress_and_its_outcome(plan_file: Path, tmp_path: Path) -> None:
    trace = tmp_path / "trace.h5"
    code, lines = work({"plan": str(plan_file), "trace": str(trace), "speed": 50})
    assert code == 0
    assert {"event", "segment", "executed", "total", "margin_s", "gate"} == set(lines[0])
    assert [line["gate"] for line in lines[:-1]] == ["open"] * (len(lines) - 2) + ["closed"]
    assert lines[-1]["event"] == "finished"
    assert lines[-1]["segments_executed"] == 600
    assert lines[-1]["stop_codes"] == {"A": 31, "B": 31}
    assert stood_with_gate_open_s(trace, speed=50) < 0.5


def stood_with_gate_open_s(path: Path, speed: float) -> float:
    """Host seconds for which the gate stayed open after the last motion; the trace ends when it closes."""
    trace = read_emulator_trace(path, machine())
    moved = np.any([np.diff(counts) != 0 for counts in trace.position_counts.values()], axis=0)
    return float(np.sum(trace.gate_open[np.flatnonzero(moved)[-1] + 2 :]) * trace.sample_period_s / speed)


def say_abort(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.write("abort\n")
    process.stdin.flush()


def close_input(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.close()


@pytest.mark.parametrize("how", [say_abort, close_input, subprocess.Popen.terminate])
def test_a_word_a_dead_parent_or_a_signal_aborts(
    how: Callable[[subprocess.Popen[str]], None], plan_file: Path, tmp_path: Path
) -> None:
    trace = tmp_path / "trace.h5"
    code, lines = work({"plan": str(plan_file), "trace": str(trace), "speed": 10}, how)
    assert code == 7
    assert lines[-1]["event"] == "failed"
    assert lines[-1]["code"] == "aborted"
    assert stood_with_gate_open_s(trace, speed=10) < 0.5


@pytest.mark.parametrize(
    "job",
    [{}, {"plan": "absent.h5"}, {"plan": "absent.h5", "speed": 0}, {"plan": "absent.h5", "colour": "red"}],
)
def test_a_job_that_cannot_be_used_is_one_clear_line(job: dict[str, object]) -> None:
    code, lines = work(job)
    assert code == 2
    assert [line["code"] for line in lines] == ["bad_input"]
