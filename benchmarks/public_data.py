"""Public data of the field, planned and executed: a flat with measured-like error and a measured fluid-jet tool."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

from benchmarks import Absent
from benchmarks._harness import FOLDER
from ibfctl.jobs.inputs import InfluenceFile, MapFile
from ibfctl.jobs.plan_files import hashed, plan_files
from ibfctl.jobs.rehearsal import rehearse
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.options import PlanOptions
from ibfctl.surface.map import Rectangle

VARIABLE = "IBFCTL_DATA"
APERTURE = Rectangle(10.0, 60.0, 5.0, 25.0)
SPEED = 25.0


def data_folder() -> Path:
    """Return the folder of the public files: named by IBFCTL_DATA, or `shared/data` beside the checkout."""
    folder = Path(os.environ.get(VARIABLE, FOLDER.parents[1] / "shared" / "data"))
    for name in ("flat_70x30mm.mat", "fluid_jet_tif.mat"):
        if not (folder / name).is_file():
            raise Absent(f"{name} is not here; set {VARIABLE} to its folder")
    return folder


def run() -> dict[str, Any]:
    """Plan and rehearse the job on the stages of the shipped simulator."""
    data = data_folder()
    with tempfile.TemporaryDirectory() as folder:
        plan_path = Path(folder) / "plan.h5"
        plan = plan_files(
            MapFile(str(data / "flat_70x30mm.mat")),
            InfluenceFile(str(data / "fluid_jet_tif.mat")),
            shipped_machine("simulator"),
            PlanOptions(clear_aperture=APERTURE),
            plan_path,
        )
        rehearsal = rehearse(plan, Path(folder) / "run.h5", plan_file=hashed(plan_path), speed=SPEED)
    planned, done = plan.summary(), rehearsal.summary()
    names = ("initial_rms_nm", "ideal_rms_nm", "executed_rms_nm", "total_time_s", "segments", "planning_time_s")
    return {
        "metrics": {name: planned[name] for name in names}
        | {
            "as_run_rms_nm": done["as_run_rms_nm"],
            "rms_difference_nm": done["rms_difference_nm"],
            "largest_end_error_counts": max(map(abs, done["final_position_error_counts"].values())),
            "failed_checks": sum(not check.passed for check in plan.certificate.checks),
        },
        "targets": {
            "rms_difference_nm": {"max": 0.01},
            "largest_end_error_counts": {"max": 1},
            "failed_checks": {"max": 0},
        },
    }
