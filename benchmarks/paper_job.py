"""The paper's raster job (985 x 168 pixels, 0.5 mm pitch, 5 mm tool): map to certified program, motion in the loop."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ibfctl.demo.job import demo_job
from ibfctl.dwell.deposition import Grid, grid_of
from ibfctl.dwell.motion import PREDICTION_POINTS, executed_removal, points_per_segment
from ibfctl.machine.description import read_machine
from ibfctl.machine.program import PvtProgram
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.planner import make_plan
from ibfctl.schedule.certificate import axis_cubics
from ibfctl.schedule.hermite import Cubics
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.levelling import rms

REPEATS, FINER = 3, 10
# Of the naive peer, spread over the run.
STAMPS = 3000


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
            "stamp_per_sample_here_s": _stamp_per_sample_s(plan.program, grid, job.influence),
            "authors_removal_12_cores_s": 1.7,
            "authors_removal_1_core_s": 27.9,
        },
    }


def _stamp_per_sample_s(program: PvtProgram, grid: Grid, influence: InfluenceFunction) -> float:
    """Time that a stamp of the influence function at every sample of the controller would take, from some of them."""
    ends = np.cumsum(program.time_samples)
    sample = np.linspace(0, ends[-1] - 1, STAMPS).astype(np.int64)
    segment = np.searchsorted(ends, sample, side="right")
    inside_samples = (sample - ends[segment] + program.time_samples[segment]).astype(np.float64)
    place = {}
    for coordinate in ("x", "y"):
        axis = program.axis_of(coordinate)
        c = axis_cubics(program, axis)
        picked = Cubics(*(part[segment] for part in (c.start, c.move, c.start_velocity, c.end_velocity, c.time_s)))
        place[coordinate] = picked.position(inside_samples * program.sample_period_s) / axis.counts_per_mm
    stamp = influence.resampled(grid.pixel_mm).rate_nm_s * program.sample_period_s
    high, wide = stamp.shape
    # A margin on all sides: stamps beside the part need no special case.
    removal_nm = np.zeros((grid.ny + 2 * high, grid.nx + 2 * wide))
    rows = np.clip(np.rint((place["y"] - grid.y0_mm) / grid.pixel_mm), -(high // 2), grid.ny + high // 2)
    columns = np.clip(np.rint((place["x"] - grid.x0_mm) / grid.pixel_mm), -(wide // 2), grid.nx + wide // 2)
    begin = time.perf_counter()
    for row, column in zip(rows.astype(int) + high // 2, columns.astype(int) + wide // 2, strict=True):
        removal_nm[row : row + high, column : column + wide] += stamp
    return (time.perf_counter() - begin) * float(ends[-1]) / STAMPS
