"""Back-to-back runs through one service, under many listeners of its events."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks._service import Listeners, service
from ibfctl.client import Client
from ibfctl.runs.places import EMULATOR

LISTENERS = 50
TIF = "gaussian:fwhm_mm=1.6,peak_nm_s=0.4,radius_mm=2"
SHARE_AT_AN_END = 0.1


@dataclass(frozen=True)
class Soaked:
    """What was seen after every run.

    Attributes
    ----------
    states
        How each run ended.
    motion_s
        Length of one run, in s of the controller.
    margins_s
        The least buffer margin of each run.
    service_mib, emulator_mib
        Resident memory of service and emulated controller after each run.
    listening
        How many listeners still listened at the end.
    wall_s
        How long it took.
    """

    states: Sequence[str]
    motion_s: float
    margins_s: Sequence[float]
    service_mib: Sequence[float]
    emulator_mib: Sequence[float]
    listening: int
    wall_s: float


def soak(duration_s: float, speed: float) -> Soaked:
    """Run one job after the other until so many seconds of motion are over, at a speed of the emulated controller."""
    states, margins_s, service_mib, emulator_mib = list[str](), list[float](), list[float](), list[float]()
    with tempfile.TemporaryDirectory(prefix="ibfctl-") as name:
        folder = Path(name)
        with service(folder, "--simulate", "--speed", f"{speed:g}") as (client, process):
            plan, motion_s = _plan(client, folder)
            begun = time.monotonic()
            with Listeners(client.url, LISTENERS) as listeners:
                while len(states) * motion_s < duration_s:
                    run = client.runs.wait(client.runs.start(plan)["id"])
                    if run["state"] != "completed":
                        print(f"  run {len(states)}: {run['state']}: {run.get('error')}", file=sys.stderr)
                    states.append(run["state"])
                    margins_s.append(run["status"]["minimum_margin_s"])
                    service_mib.append(_resident_mib(process))
                    emulator_mib.append(_resident_mib(json.loads((folder / "data" / EMULATOR).read_text())["pid"]))
                    if len(states) % 10 == 0:
                        print(f"  {len(states)} runs, {service_mib[-1]:.1f} MiB", file=sys.stderr)
                listening = listeners.listening
            wall_s = time.monotonic() - begun
    return Soaked(states, motion_s, margins_s, service_mib, emulator_mib, listening, wall_s)


def growth(values: Sequence[float]) -> float:
    """Return by how much the last values are larger than those after the first ones, as a share of these."""
    at_an_end = max(round(SHARE_AT_AN_END * len(values)), 1)
    return float(np.median(values[-at_an_end:]) / np.median(values[at_an_end : 2 * at_an_end]) - 1)


def _plan(client: Client, folder: Path) -> tuple[str, float]:
    """Plan a small part; return the plan's id and its time."""
    y, x = np.mgrid[-1:1:32j, -1:1:48j]
    path = folder / "map.npz"
    np.savez(path, height_nm=8 * x**2 + 5 * y**2 * x + 2 * np.cos(5 * x), pixel_mm=0.25)
    surface, influence = client.maps.add(path)["id"], client.influences.add(TIF, pixel_mm=0.1)["id"]
    plan = client.plans.wait(client.plans.create(surface, influence, pitch_mm=0.5, step_mm=0.5)["id"])
    return plan["id"], plan["summary"]["total_time_s"]


def _resident_mib(process: int) -> float:
    for line in Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    raise RuntimeError(f"process {process} has no memory")
