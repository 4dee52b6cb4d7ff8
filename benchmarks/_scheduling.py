"""A raster of any number of segments with the dwell times of a figured surface, for the scheduler's benchmarks."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.path.raster import raster
from ibfctl.path.tool_path import ToolPath
from ibfctl.schedule import programme, velocity
from ibfctl.schedule.scheduler import PvtSchedule, schedule, shortest_times
from ibfctl.surface.map import Rectangle

PITCH_MM, CORRIDOR_MM = 0.5, 0.025
REPEATS = 3
_SPEED_MM_S, _ROUGH_SHARE = 12.0, 0.005


def measure(segments: int, step_mm: float) -> dict[str, Any]:
    """Schedule and certify on one core; of repetitions the quickest counts."""
    path = raster_of(segments, step_mm)
    machine = read_machine(shipped_machine("nsls2-ibf"))
    dwell_s = dwell_of(path, machine)
    seconds = []
    with one_core():
        for _ in range(REPEATS):
            begin = time.perf_counter()
            scheduled = schedule(path, dwell_s, machine, CORRIDOR_MM, stretch=True)
            seconds.append(time.perf_counter() - begin)
    assert scheduled.certificate.passed
    return {
        "schedule_s": min(seconds),
        "segments": len(scheduled.program),
        "programme_nodes": programme_nodes(path, dwell_s, machine),
        "stretched_segments": stretched_segments(scheduled, dwell_s, machine),
        "checks": len(scheduled.certificate.checks),
        "total_time_s": scheduled.program.total_time_s,
    }


def raster_of(segments: int, step_mm: float) -> ToolPath:
    """Serpentine with `segments` segments over the width of the paper's stages."""
    path = raster(Rectangle(-104.0, 104.0, -59.0, 59.0), PITCH_MM, step_mm)
    if path.segments < segments:
        raise ValueError(f"the raster has {path.segments} segments, fewer than {segments}")
    return ToolPath(path.x_mm[: segments + 1], path.y_mm[: segments + 1])


def dwell_of(path: ToolPath, machine: MachineDescription) -> NDArray[np.float64]:
    """Times that vary smoothly by a factor of four, and abruptly at one segment in two hundred."""
    random = np.random.default_rng(1)
    smooth = ndimage.gaussian_filter1d(random.normal(size=path.segments), 8.0)
    relative = np.exp(0.35 * smooth / smooth.std())
    rough = random.uniform(size=path.segments) < _ROUGH_SHARE
    relative[rough] *= random.choice([0.3, 4.0], size=int(rough.sum()))
    wished_s: NDArray[np.float64] = relative * path.length_mm / _SPEED_MM_S
    return np.maximum(wished_s, shortest_times(path, machine))


def programme_nodes(path: ToolPath, dwell_s: NDArray[np.float64], machine: MachineDescription) -> int:
    """Nodes that are handed to the quadratic programme the first time, because the plain spline breaks a limit."""
    handed = []
    solve = programme.solve_programme

    def counting(*arguments: Any) -> Any:
        handed.append(int(arguments[-1].sum()))
        return solve(*arguments)

    with patch.object(velocity, "solve_programme", counting):
        schedule(path, dwell_s, machine, CORRIDOR_MM, stretch=True)
    return handed[0] if handed else 0


def stretched_segments(scheduled: PvtSchedule, dwell_s: NDArray[np.float64], machine: MachineDescription) -> int:
    """Segments of the path that last longer than was asked for, by more than rounding."""
    return int((scheduled.segment_time_s > dwell_s + 2 * machine.sample_period_s).sum())


@contextmanager
def one_core() -> Iterator[None]:
    """Bind the process to one core: whatever threads a library starts, they share it."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)
