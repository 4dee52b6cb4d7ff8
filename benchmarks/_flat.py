"""The public flat and two Gaussian tools: dwell points anywhere, no machine limits.

Clear aperture x 10 to 60 mm, y 12.5 to 17.5 mm; dwell points every 0.5 mm over the aperture and the tool's radius
around it; the residual counts after piston and tilt, on the pixels of the map.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.public_data import data_folder
from ibfctl.dwell.deposition import grid_of
from ibfctl.dwell.methods.inverse_filter import inverse_filter
from ibfctl.dwell.methods.nnls import nnls
from ibfctl.dwell.misfit import cell_size, make_misfit
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import DwellProblem, Regularisation
from ibfctl.dwell.trade_off import Aim, Effort, aim_at
from ibfctl.planning.aperture import clear_aperture_mask
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.levelling import Levelling, rms
from ibfctl.surface.map import Rectangle, SurfaceMap
from ibfctl.surface.readers import read_map

APERTURE = Rectangle(10.0, 60.0, 12.5, 17.5)
SPACING_MM = 0.5
# Finer than the planner's own: on so small a part it costs little, and a residual of 0.3 nm feels 0.002.
CELLS_PER_WIDTH = 16
# Of the peer: iterations until it hardly moves, and the price of a second relative to the peak removal rate.
NNLS_ITERATIONS, NNLS_PRICE_SHARE = 3000, 5e-6


@dataclass(frozen=True)
class Tool:
    """A Gaussian tool, and the margin above the best residual that is given for a shorter time."""

    fwhm_mm: float
    peak_nm_s: float
    radius_mm: float
    margin: float

    @property
    def aim(self) -> Aim:
        """The shortest time within the margin."""
        return Aim(self.margin)

    def influence(self, pixel_mm: float) -> InfluenceFunction:
        """Return the tool on the pitch of a map."""
        return gaussian(self.fwhm_mm, self.peak_nm_s, self.radius_mm, pixel_mm)


FAST = Tool(5.0, 10.0, 7.5, margin=0.0035)
SLOW = Tool(2.7752, 0.4, 5.0, margin=0.01)


def flat() -> SurfaceMap:
    """Read the map; absent where the public data are."""
    return read_map(str(data_folder() / "flat_70x30mm.mat"), array="Z_to_remove")


@dataclass(frozen=True)
class FlatJob:
    """Dwell points anywhere on and around the clear aperture, and what their times leave on its pixels."""

    problem: DwellProblem
    rms_nm: Callable[[np.ndarray], float]


def flat_job(surface: SurfaceMap, tool: Tool) -> FlatJob:
    """Make the job of a tool."""
    influence, mask = tool.influence(surface.pixel_mm), clear_aperture_mask(surface, APERTURE)
    misfit = make_misfit(surface, mask, influence, "tilt", cell_size(surface, influence, CELLS_PER_WIDTH))
    x_mm, y_mm = _dwell_points(tool.radius_mm)
    operator = RemovalOperator(misfit.grid, misfit.influence, x_mm, y_mm)
    on_pixels = RemovalOperator(grid_of(surface), influence, x_mm, y_mm)
    levelling = Levelling.over(mask, "tilt")
    target_nm = levelling(surface.height_nm[mask])

    def rms_nm(time_s: np.ndarray) -> float:
        return rms(target_nm - levelling(on_pixels(time_s)[mask]))

    nothing = np.zeros(x_mm.size)
    return FlatJob(DwellProblem(operator, misfit, nothing, np.full(x_mm.size, np.inf)), rms_nm)


def without_limits(surface: SurfaceMap, tool: Tool) -> dict[str, Any]:
    """Solve dwell times from a map in memory; return residual, beam time and how long it took."""
    begin = time.perf_counter()
    job = flat_job(surface, tool)
    found = aim_at(
        job.problem,
        job.rms_nm,
        tool.aim,
        start_s=job.problem.lower_s,
        regularisation=Regularisation(smoothing=0.0),
        effort=Effort(),
    )
    planning_s = time.perf_counter() - begin
    return {
        "rms_nm": job.rms_nm(found.chosen.time_s),
        "dwell_s": float(found.chosen.time_s.sum()),
        "planning_s": planning_s,
        "floor_rms_nm": found.floor.rms_nm,
        "points": found.chosen.time_s.size,
    }


def peers(surface: SurfaceMap, tool: Tool) -> dict[str, float]:
    """Solve the same job by inverse filtering and by non-negative least squares; the name says whose figure it is."""
    figures = {}
    price = NNLS_PRICE_SHARE * tool.peak_nm_s
    for name, method in (
        ("inverse_filter", inverse_filter),
        ("nnls", partial(nnls, price_nm2_s=price, iterations=NNLS_ITERATIONS)),
    ):
        begin = time.perf_counter()
        job = flat_job(surface, tool)
        time_s = method(job.problem).time_s
        figures[f"{name}_here_planning_s"] = time.perf_counter() - begin
        figures[f"{name}_here_rms_nm"] = job.rms_nm(time_s)
        figures[f"{name}_here_dwell_s"] = float(time_s.sum())
    return figures


def _dwell_points(radius_mm: float) -> tuple[np.ndarray, np.ndarray]:
    a = APERTURE
    x_mm = np.arange(a.x0_mm - radius_mm, a.x1_mm + radius_mm + 1e-9, SPACING_MM)
    y_mm = np.arange(a.y0_mm - radius_mm, a.y1_mm + radius_mm + 1e-9, SPACING_MM)
    x_mm, y_mm = np.meshgrid(x_mm, y_mm)
    return x_mm.ravel(), y_mm.ravel()
