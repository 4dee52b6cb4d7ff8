"""Latency of a run's status, and the run's buffer margin, under 50 listeners of events and a plan being solved."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from benchmarks._service import Listeners, Planners, moving_run, plan_of_hours, service
from ibfctl.client import Client

LISTENERS = 50
DURATION_S = 60.0
POLL_S = 0.05


def run() -> dict[str, Any]:
    """Run twice: alone, and under load."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with service(folder, "--simulate") as (client, _):
            plan = plan_of_hours(client, folder)
            alone = _watched(client, plan)
            with Planners(client, folder, 1) as planners, Listeners(client.url, LISTENERS) as listeners:
                loaded = _watched(client, plan)
                samples = listeners.samples
    metrics = {
        "status_p50_ms": float(np.percentile(loaded["latency_ms"], 50)),
        "status_p99_ms": float(np.percentile(loaded["latency_ms"], 99)),
        "alone_status_p99_ms": float(np.percentile(alone["latency_ms"], 99)),
        "minimum_margin_s": loaded["margin_s"],
        "alone_minimum_margin_s": alone["margin_s"],
        "margin_ratio": loaded["margin_s"] / alone["margin_s"],
        "underruns": float(loaded["ended"] + alone["ended"]),
        "telemetry_hz": samples / LISTENERS / DURATION_S,
        "share_of_time_with_plans_running": planners.busy / planners.looks,
    }
    targets = {
        "status_p99_ms": {"max": 20.0},
        "margin_ratio": {"min": 0.8},
        "underruns": {"max": 0.0},
        "telemetry_hz": {"min": 5.0, "max": 10.0},
    }
    return {"metrics": metrics, "targets": targets}


def _watched(client: Client, plan: str) -> dict[str, Any]:
    """Run a plan for a while, ask for its status at a steady rate, and abort it."""
    moving = moving_run(client, plan)
    latency_ms = []
    with httpx.Client(base_url=client.url, timeout=30) as panel:
        end = time.monotonic() + DURATION_S
        while time.monotonic() < end:
            asked = time.monotonic()
            panel.get(f"/v1/runs/{moving}").raise_for_status()
            latency_ms.append(1e3 * (time.monotonic() - asked))
            time.sleep(max(POLL_S - (time.monotonic() - asked), 0.0))
    record = client.runs.show(moving)
    if record["state"] != "running":
        print(record.get("error") or record["state"], file=sys.stderr)
    client.runs.abort(moving)
    client.runs.wait(moving)
    return {
        "latency_ms": latency_ms,
        "margin_s": record["status"]["minimum_margin_s"],
        "ended": record["state"] != "running",
    }
