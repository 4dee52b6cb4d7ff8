"""The path of a plan as a part program for a Sinumerik, with the time that it will take there."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ibfctl.path.smoothing import drive_shares, smooth_corners
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.job import corridor_of
from ibfctl.planning.plan import Plan
from ibfctl.schedule.kinematics import time_corners
from ibfctl.schedule.kinematics_drive import drive_of

_S_PER_MIN = 60.0


def gcode_lines(plan: Plan, title: str) -> Iterator[str]:
    """Yield a part program: the programmed path, smoothed by the control itself within the plan's tolerance.

    The feed rate of a block gives it the dwell time of its segment; a segment that does not move is a dwell. `title`
    goes into a comment.
    """
    path = ToolPath(*plan.options.placement(plan.path.x_mm, plan.path.y_mm))
    tolerance_mm = plan.options.corner_tolerance_mm or corridor_of(plan.options)
    drive = drive_of(plan.machine)
    length_mm, time_s = path.length_mm, plan.dwell.time_s
    fastest = float(np.hypot(*drive.v_max_mm_s))
    moving = length_mm > 0
    feed = np.full(length_mm.size, fastest)
    np.divide(length_mm, time_s, out=feed, where=moving & (time_s > 0))
    feed = np.clip(feed, 1e-6, fastest)
    timing = time_corners(smooth_corners(path, tolerance_mm, drive_shares(path)), drive, feed)
    standing_s = float(time_s[~moving].sum())
    yield f"; {title[:70]}"
    yield f"; predicted cycle time {timing.cycle_time_s + standing_s:.3f} s"
    yield f"; dwell times of the plan {time_s.sum():.3f} s"
    yield f"; corners are at most {timing.corners.largest_deviation_mm:.4f} mm off the programmed path"
    yield "G17 G90 G94 G710"
    yield f"G0 X{path.x_mm[0]:.5f} Y{path.y_mm[0]:.5f}"
    yield f"SOFT G642 CTOL={tolerance_mm:.5f}"
    feeds = (_S_PER_MIN * feed).tolist()
    rows = zip(path.x_mm[1:].tolist(), path.y_mm[1:].tolist(), feeds, moving.tolist(), time_s.tolist(), strict=True)
    for x, y, feed_mm_min, moves, dwell_s in rows:
        yield f"G1 X{x:.5f} Y{y:.5f} F{feed_mm_min:.3f}" if moves else f"G4 F{dwell_s:.4f}"
    yield "M30"
