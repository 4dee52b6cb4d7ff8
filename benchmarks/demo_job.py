"""The demo from seed to as-run residual: what is left, how well it agrees with the plan, how long it takes."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from typing import Any


def run() -> dict[str, Any]:
    """Run `ibfctl demo --json` as a user does."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        command = [sys.executable, "-m", "ibfctl", "demo", "--out", folder, "--json"]
        done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
        wall_s = time.perf_counter() - begin
    figures = json.loads(done.stdout)
    return {
        "metrics": {
            "initial_rms_nm": figures["initial_rms_nm"],
            "ideal_rms_nm": figures["ideal_rms_nm"],
            "executed_rms_nm": figures["executed_rms_nm"],
            "as_run_rms_nm": figures["as_run_rms_nm"],
            "rms_difference_nm": figures["rms_difference_nm"],
            "largest_end_error_counts": max(map(abs, figures["final_position_error_counts"].values())),
            "failed_checks": sum(not check["passed"] for check in figures["certificate"]["checks"].values()),
            "run_time_s": figures["total_time_s"],
            "segments": figures["segments_executed"],
            "minimum_buffer_margin_s": figures["minimum_buffer_margin_s"],
            "planning_s": figures["planning_time_s"],
            "wall_s": wall_s,
        },
        "targets": {
            "as_run_rms_nm": {"max": 0.30},
            "rms_difference_nm": {"max": 0.01},
            "largest_end_error_counts": {"max": 1},
            "failed_checks": {"max": 0},
            "wall_s": {"max": 90.0},
        },
    }
