"""The journal and the plan give again, byte for byte, what went over the wire."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.jobs import small_run
from support.proxy import Proxy

from ibfctl.errors import RunError
from ibfctl.planning.file import read_plan, write_plan
from ibfctl.runs.emulator import emulated_controller
from ibfctl.runs.launch import start_worker
from ibfctl.runs.transcript import transcript

HANDLES = ("stream", "status", "gate", "abort")
SPEED = 50.0


def test_a_replay_of_the_journal_is_the_wire_transcript(tmp_path: Path) -> None:
    with emulated_controller(None, speed=SPEED) as emulated, Proxy(emulated.host, emulated.port) as proxy:
        folder = small_run(tmp_path, proxy.port, SPEED, segments=600)
        with start_worker(folder) as worker:
            assert worker.wait(60) == 0, (folder / "worker.log").read_text()
        seen = dict(zip(HANDLES, proxy.commands, strict=True))
    assert transcript(folder) == seen
    assert seen["stream"].count(b"\rPVA=") == 600 + 1  # with the end marker

    plan = read_plan(folder / "plan.h5")
    plan.program.axes["A"].increment_counts[np.array([300, 301])] += np.array([1, -1])
    (folder / "plan.h5").unlink()
    write_plan(plan, folder / "plan.h5")
    with pytest.raises(RunError, match="the plan does not give what was sent"):
        transcript(folder)
