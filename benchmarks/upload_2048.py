"""Upload of a map of 2048 x 2048 pixels, 32 MiB, to its preview; and what of that stays in the service's memory."""

from __future__ import annotations

import re
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._service import service

PIXELS = 2048
UPLOADS = 3


def run() -> dict[str, Any]:
    """Upload some maps, one after the other, and fetch the preview of each."""
    seconds = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        y, x = np.mgrid[-1 : 1 : PIXELS * 1j, -1 : 1 : PIXELS * 1j]
        np.savez(folder / "map.npz", height_nm=30 * x**2 + 5 * np.sin(40 * x * y), pixel_mm=0.05)
        with service(folder, "--simulate") as (client, process):
            client.info()
            before = _peak_bytes(process)
            for number in range(UPLOADS):
                begun = time.monotonic()
                record = client.maps.add(folder / "map.npz")
                client.maps.download(record["id"], "preview.png", folder / f"{number}.png")
                seconds.append(time.monotonic() - begun)
            growth = _peak_bytes(process) - before
        size = (folder / "map.npz").stat().st_size
    metrics = {"slowest_s": max(seconds), "memory_growth_mib": growth / 2**20, "file_mib": size / 2**20}
    return {"metrics": metrics, "targets": {"slowest_s": {"max": 3.0}, "memory_growth_mib": {"max": 100.0}}}


def _peak_bytes(process: int) -> int:
    """Return the most memory that a process has held so far."""
    status = Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    found = re.search(r"VmHWM:\s+(\d+) kB", status)
    assert found is not None  # Linux tells it of every process
    return 1024 * int(found[1])
