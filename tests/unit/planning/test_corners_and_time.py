"""Wang et al. 2023, J. Manuf. Process. 88, section 4.2: what a path's corners cost, on made maps and paths.

Raster, maze and random adaptive path take about the same time where the removal takes it, and the motion leaves more
behind at corners than on straight lines: the more, the sharper they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ibfctl.demo.job import demo_job
from ibfctl.dwell.deposition import Grid
from ibfctl.dwell.motion import executed_removal
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.planner import make_plan
from ibfctl.schedule.scheduler import schedule
from ibfctl.surface.influence import gaussian

MACHINE = read_machine(shipped_machine("nsls2-ibf"))
TOOL = gaussian(1.963, 1.0, 2.5, 0.1)


def test_the_paths_take_the_same_time_and_corners_leave_a_larger_residual() -> None:
    job = demo_job(4, (60, 120))
    options = replace(job.options, pitch_mm=0.5, step_mm=0.5, loop=False)
    time_s, executed_nm = {}, {}
    for path in ("raster", "maze", "random"):
        plans = [
            make_plan(job.surface, TOOL, MACHINE, replace(options, path=path, seed=seed)).summary()
            for seed in ((0,) if path == "raster" else (0, 1))
        ]
        time_s[path] = np.mean([plan["total_time_s"] for plan in plans])
        executed_nm[path] = np.mean([plan["executed_rms_nm"] for plan in plans])
    assert max(time_s.values()) < 1.1 * min(time_s.values())
    assert executed_nm["maze"] > 1.3 * executed_nm["raster"]
    assert executed_nm["random"] > 1.3 * executed_nm["raster"]


def test_the_sharper_the_corners_of_a_zigzag_the_more_its_motion_misses() -> None:
    missed = []
    for turn_deg in (0, 30, 60, 90, 120, 150):
        direction = 0.5 * np.radians(turn_deg) * np.where(np.arange(120) % 2, 1, -1)
        x_mm, y_mm = (np.concatenate([[0.0], np.cumsum(0.5 * part)]) for part in (np.cos(direction), np.sin(direction)))
        path = ToolPath(x_mm, y_mm)
        dwell_s = 0.15 * (1 + 0.5 * np.sin(2 * np.pi * path.dwell_x_mm / 9))
        program = schedule(path, dwell_s, MACHINE, 0.025, stretch=True).program
        # The limits ask for no more time: corners alone make the difference.
        assert program.total_time_s == pytest.approx(dwell_s.sum(), rel=1e-3)
        grid = Grid(80, int((x_mm.max() + 6) / 0.1), 0.1, -3.0, -4.0)
        wanted_nm = RemovalOperator(grid, TOOL, path.dwell_x_mm, path.dwell_y_mm)(dwell_s)
        missed.append(np.linalg.norm(executed_removal(program, grid, TOOL) - wanted_nm) / np.linalg.norm(wanted_nm))
    assert (np.diff(missed) > 0).all()
    assert missed[-1] > 4 * missed[0]
