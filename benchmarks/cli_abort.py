"""`ibfctl abort` from the shell prompt to the `AB` bytes at the emulated controller, during a run."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks._service import moving_run, percentiles_ms, plan_of_hours, service_on_a_wire

ABORTS = 40
COMMAND = Path(sys.executable).with_name("ibfctl")


def run() -> dict[str, Any]:
    """Abort run after run by the command line."""
    seconds, starts = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with service_on_a_wire(folder) as (client, _, wire):
            plan = plan_of_hours(client, folder)
            for _ in range(ABORTS):
                moving = moving_run(client, plan)
                begun = time.monotonic()
                subprocess.run([sys.executable, "-c", "import ibfctl.cli.main, ibfctl.cli.abort"], check=True)
                starts.append(time.monotonic() - begun)
                begun = time.monotonic()
                # The url leads nowhere: only the pipe of the worker can have told it.
                abort = [str(COMMAND), "abort", "--data", str(folder / "data"), "--url", "http://127.0.0.1:9"]
                subprocess.run(abort, check=True, stdout=subprocess.DEVNULL)
                seconds.append(wire.await_abort(begun) - begun)
                client.runs.wait(moving)
    start = percentiles_ms(starts)
    metrics = {**percentiles_ms(seconds), "start_p50_ms": start["p50_ms"], "start_p99_ms": start["p99_ms"]}
    return {"metrics": metrics, "targets": {"p99_ms": {"max": 300.0}, "start_p99_ms": {"max": 150.0}}}
