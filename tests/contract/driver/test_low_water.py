"""The guard takes the buffer for about to run dry by how long what waits lasts, not by how much it is."""

import numpy as np
from support.programs import SAMPLE_S, connected, machine

from ibfctl.machine.program import AxisProgram, PvtProgram
from ibfctl.runs.emulator import emulated_controller
from ibfctl.runs.streamer import execute


def test_short_segments_among_long_ones_do_not_end_a_run() -> None:
    times = np.array([2000] * 8 + [2] * 20 + [2000] * 8, dtype=np.int64)
    rest = np.zeros(times.size, dtype=np.int64)
    axes = {letter: AxisProgram(rest, rest, 0, 1000.0) for letter in "AB"}
    job = PvtProgram(axes, {"x": "A", "y": "B"}, times, SAMPLE_S)
    with emulated_controller(None, speed=10) as emulated:
        bench = emulated.in_place_of(machine())
        with connected(bench) as controller:
            outcome = execute(job, bench, controller, time_scale=10)
    assert outcome.segments_executed == times.size
