"""The paper's raster job (985 x 168 pixels, 0.5 mm pitch, 5 mm tool): map to certified program, motion in the loop."""

from __future__ import annotations

import time
from typing import Any

from ibfctl.demo.job import demo_job
from ibfctl.dwell.deposition import grid_of
from ibfctl.dwell.motion import PREDICTION_POINTS, executed_removal, points_per_segment
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.planner import make_plan
from ibfctl.surface.levelling import rms

REPEATS, FINER = 3, 10


def run() -> dict[str, Any]:
    """Plan, and predict the removal along the cubics at two samplings; of repetitions the quickest counts."""
    job, machine = demo_job(), read_machine(shipped_machine("nsls2-ibf"))
    planning_s, removal_s = [], []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        plan = make_plan(job.surface, job.influence, machine, job.options)
        planning_s.append(time.perf_counter() - begin)
    grid = grid_of(job.surface)
    for _ in range(REPEATS):
        begin = time.perf_counter()
        removal_nm = executed_removal(plan.program, grid, job.influence)
        removal_s.append(time.perf_counter() - begin)
    points = max(PREDICTION_POINTS, points_per_segment(plan.program, job.influence))
    finer_nm = executed_removal(plan.program, grid, job.influence, FINER * points)
    assert plan.prediction is not None
    mask = plan.prediction.clear_aperture
    figures = plan.summary()
    return {
        "metrics": {
            "planning_s": min(planning_s),
            "executed_removal_s": min(removal_s),
            "finer_sampling_rms_nm": rms((finer_nm - removal_nm)[mask]),
            "segments": len(plan.program),
            "rounds": len(plan.rounds),
            **{name: figures[name] for name in ("ideal_rms_nm", "executed_rms_nm", "total_time_s")},
        },
        "targets": {
            "planning_s": {"max": 1.7},
            "executed_removal_s": {"max": 0.1},
            "finer_sampling_rms_nm": {"max": 0.001},
        },
        "peers": {
            "authors_removal_12_cores_s": 1.7,
            "authors_removal_1_core_s": 27.9,
        },
    }
