"""An abort over REST to its bytes at the controller, under 200 other requests/s, while two plans are solved."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import httpx

from benchmarks._service import Planners, moving_run, percentiles_ms, plan_of_hours, service_on_a_wire

ABORTS = 40
RATE_HZ = 200


def run() -> dict[str, Any]:
    """Abort run after run over a connection that is open."""
    seconds = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with service_on_a_wire(folder) as (client, _, wire):
            plan = plan_of_hours(client, folder)
            command = [sys.executable, "-m", "benchmarks._load", client.url, str(RATE_HZ)]
            with (
                Planners(client, folder, 2) as planners,
                subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as load,
            ):
                with httpx.Client(base_url=client.url, timeout=30) as panel:
                    for _ in range(ABORTS):
                        moving = moving_run(client, plan)
                        panel.get("/healthz")  # a panel that is open holds its connection
                        begun = time.monotonic()
                        panel.post(f"/v1/runs/{moving}/abort").raise_for_status()
                        seconds.append(wire.await_abort(begun) - begun)
                        client.runs.wait(moving)
                said, _ = load.communicate("")
    metrics = {
        **percentiles_ms(seconds),
        "load_requests_per_s": float(said),
        "share_of_time_with_plans_running": planners.busy / planners.looks,
    }
    return {"metrics": metrics, "targets": {"p99_ms": {"max": 20.0}, "load_requests_per_s": {"min": 0.95 * RATE_HZ}}}
