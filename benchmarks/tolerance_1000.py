"""1000 draws of the tolerances of the paper's raster job, by the command line on two processes."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from ibfctl.demo.job import demo_job
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.file import write_plan
from ibfctl.planning.planner import make_plan

DRAWS, WORKERS = 1000, 2


def run() -> dict[str, Any]:
    """Time the whole command, its start and that of its workers included."""
    job, machine = demo_job(), read_machine(shipped_machine("nsls2-ibf"))
    with tempfile.TemporaryDirectory() as folder:
        plan = Path(folder) / "plan.h5"
        write_plan(make_plan(job.surface, job.influence, machine, job.options), plan)
        command = [sys.executable, "-m", "ibfctl", "tolerance", str(plan), "--draws", str(DRAWS)]
        begin = time.perf_counter()
        done = subprocess.run([*command, "--workers", str(WORKERS), "--json"], capture_output=True, check=True)
        wall_s = time.perf_counter() - begin
    figures = json.loads(done.stdout)
    return {
        "metrics": {
            "wall_s": wall_s,
            "predicted_rms_nm": figures["predicted_rms_nm"],
            "median_rms_nm": figures["rms_nm"]["percentiles"]["p50"],
            "p95_rms_nm": figures["rms_nm"]["percentiles"]["p95"],
            **{f"{name}_share": cause["share"] for name, cause in figures["causes"].items()},
        },
        "targets": {"wall_s": {"max": 60}},
    }
