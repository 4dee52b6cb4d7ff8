"""One step whose limits leave no room must not stop a long path at every node."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.path.random_adaptive import LATTICE_PER_DISTANCE, POINTS_DISTANCE, random_adaptive
from ibfctl.path.scatter import Field
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule.scheduler import schedule, shortest_times

MACHINE = read_machine(shipped_machine("nsls2-ibf"))


def random_path(seed: int) -> ToolPath:
    """Some 500 nodes without a single stop."""
    pitch_mm = 0.6
    lattice_mm = POINTS_DISTANCE * pitch_mm / LATTICE_PER_DISTANCE
    margin_mm = 1.5 * POINTS_DISTANCE * pitch_mm
    x, y = np.meshgrid(
        np.arange(-9 - margin_mm, 9 + margin_mm, lattice_mm), np.arange(-8 - margin_mm, 8 + margin_mm, lattice_mm)
    )
    inside = np.where((np.abs(x) < 9) & (np.abs(y) < 5), 1.0, np.nan)
    place = x[0, 0], y[0, 0]
    pitch, needed = (Field(values, lattice_mm, *place) for values in (np.full(x.shape, pitch_mm), inside))
    return random_adaptive(pitch, needed, seed)


@pytest.mark.parametrize(("seed", "spread"), [(1, 1.0), (11, 2.0), (14, 0.5), (18, 1.0), (20, 1.0), (22, 0.5)])
def test_rests_stay_where_the_limits_ask_for_them(seed: int, spread: float) -> None:
    path = random_path(seed)
    random = np.random.default_rng(seed)
    time_s = shortest_times(path, MACHINE) * (1 + spread * random.lognormal(0.0, 1.0, path.segments))
    scheduled = schedule(path, time_s, MACHINE, 0.03, stretch=True)
    assert scheduled.certificate.passed
    assert scheduled.program.total_time_s == pytest.approx(time_s.sum(), rel=1e-3)
    x, y = (axis.end_velocity_counts_s for axis in scheduled.program.axes.values())
    assert np.mean((x == 0) & (y == 0)) < 0.1
