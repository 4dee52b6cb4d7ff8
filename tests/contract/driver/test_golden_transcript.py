"""The bytes that go out for a small plan, handle by handle in order of arrival, are a reviewed file."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import numpy as np
from support.fake_galil import GATE, FakeGalil
from support.programs import SAMPLE_S, connected, machine

from ibfctl.machine.program import AxisProgram, PvtProgram
from ibfctl.runs.streamer import execute

GOLDEN = Path(__file__).with_name("golden_transcript.txt")
HANDLES = ("stream", "status", "gate", "abort")
PULSE, ALIVE = "gbeat=TIME", "MG _XQ0"
"""Signs of life on the gate's handle, and of the guard, come when they come."""


def small_plan() -> PvtProgram:
    x = AxisProgram(np.array([57, 151, 151, 57]), np.array([438, 750, 438, 0]), -1000, 1000.0)
    y = AxisProgram(np.array([0, -40, -60, 0]), np.array([0, -250, 0, 0]), 20, 1000.0)
    times = np.array([256, 256, 512, 2048])
    return PvtProgram({"A": x, "B": y}, {"x": "A", "y": "B"}, times, SAMPLE_S)


def transcript(log: list[tuple[int, str]]) -> str:
    steady = [entry for entry in log if entry not in ((GATE, PULSE), (GATE, ALIVE))]
    lines = [f"{HANDLES[handle]:6} {command.encode('unicode_escape').decode()}" for handle, command in steady]
    return "".join(
        f"{line}\n" if len(list(same)) == 1 else f"{line}  (repeated)\n" for line, same in groupby(lines)
    )


def test_the_bytes_of_a_small_plan() -> None:
    with FakeGalil(sample_rate_hz=102_400) as galil:
        bench = machine(port=galil.port)
        with connected(bench) as controller:
            outcome = execute(small_plan(), bench, controller, time_scale=100)
    assert outcome.segments_executed == 4
    assert (GATE, PULSE) in galil.log
    assert transcript(galil.log) == GOLDEN.read_text(encoding="ascii")
