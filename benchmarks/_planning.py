"""Made jobs of any size, planned in a process of their own so that its memory can be read."""

from __future__ import annotations

import math
import multiprocessing
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.planner import make_plan
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.map import SurfaceMap

MACHINE = "nsls2-ibf"
PIXEL_MM = 0.1
TIF_FWHM_MM, TIF_RADIUS_MM, TIF_PEAK_NM_S = 5.0, 7.5, 10.0
RMS_NM, FINEST_MM = 20.0, 3.0
TRAVEL_MM = 150.0


@dataclass(frozen=True)
class Planned:
    """What one planning cost and reached."""

    planning_s: float
    peak_gib: float
    points: int
    initial_rms_nm: float
    executed_rms_nm: float
    total_time_s: float
    rounds: int
    failed_checks: int

    def metrics(self) -> dict[str, float]:
        """Return the figures by name."""
        return dict(vars(self))


def stages() -> MachineDescription:
    """Return the published stages, with travel enough for the largest of the made parts."""
    machine = read_machine(shipped_machine(MACHINE))
    axes = {
        letter: axis.model_copy(update={"travel_min_mm": -TRAVEL_MM, "travel_max_mm": TRAVEL_MM})
        for letter, axis in machine.axes.items()
    }
    return machine.model_copy(update={"axes": axes})


def made_map(pixels: int) -> SurfaceMap:
    """Make a square map: a bowl, and smooth noise of which most can be corrected."""
    y, x = np.mgrid[-1 : 1 : pixels * 1j, -1 : 1 : pixels * 1j]
    height_nm = x**2 + y**2
    noise = np.random.default_rng(11).normal(size=height_nm.shape)
    for width_mm, share in ((FINEST_MM, 0.2), (3 * FINEST_MM, 0.5)):
        smooth = ndimage.gaussian_filter(noise, width_mm / PIXEL_MM, mode="reflect")
        height_nm += share * height_nm.std() * smooth / smooth.std()
    return SurfaceMap.centred(height_nm * (RMS_NM / height_nm.std()), PIXEL_MM)


def made_tool() -> InfluenceFunction:
    """Make the tool of all made jobs."""
    return gaussian(TIF_FWHM_MM, TIF_PEAK_NM_S, TIF_RADIUS_MM, PIXEL_MM)


def plan_made(pixels: int, points: int, *, loop: bool) -> Planned:
    """Plan a square map with about so many dwell points on a raster; the whole map is the clear aperture."""
    surface, influence = made_map(pixels), made_tool()
    pitch_mm = (pixels * PIXEL_MM + 2 * influence.radius_mm) / math.sqrt(points)
    options = PlanOptions(pitch_mm=pitch_mm, step_mm=pitch_mm, loop=loop)
    machine = stages()
    begin = time.perf_counter()
    plan = make_plan(surface, influence, machine, options)
    planning_s = time.perf_counter() - begin
    figures = plan.summary()
    return Planned(
        planning_s,
        resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
        plan.path.segments,
        float(figures["initial_rms_nm"]),  # type: ignore[arg-type]
        float(figures["executed_rms_nm"]),  # type: ignore[arg-type]
        plan.program.total_time_s,
        len(plan.rounds),
        sum(not check.passed for check in plan.certificate.checks),
    )


def plan_apart(pixels: int, points: int, *, loop: bool) -> Planned:
    """Do the same in a new process: its peak memory is that of this job alone."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(plan_made, pixels, points, loop=loop).result()
