"""What a plan leaves when the tool, the part and the stages are not quite as planned.

Nothing is approximated but the tool's own orientation: every draw spends the program's time at the displaced points
of its cubics and convolves it with the changed influence function, which takes some hundredths of a second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ibfctl.dwell.deposition import grid_of
from ibfctl.dwell.motion import PREDICTION_POINTS, MotionPoints, motion_points, points_per_segment
from ibfctl.dwell.operator import removal_of_samples
from ibfctl.machine.placement import Placement
from ibfctl.machine.program import PvtProgram
from ibfctl.planning.aperture import pixels_of
from ibfctl.planning.job import seen_on_part
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import Plan
from ibfctl.planning.target import Target
from ibfctl.schedule.certificate import axis_cubics
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.levelling import peak_to_valley, rms
from ibfctl.surface.map import SurfaceMap

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Draw:
    """How one run differs from its plan.

    Attributes
    ----------
    rate_drift
        Relative change of the removal rate from the beginning of the run to its end, linear in time.
    tif_width
        Logarithm of the tool's width over the planned one; the volume rate stays.
    offset_x_mm, offset_y_mm, rotation_rad
        Where the part really lies: turned about the middle of its clear aperture, then moved.
    lag_x_s, lag_y_s
        Following error of each axis over its velocity.
    height_noise_nm, noise_seed
        Standard deviation of the measured heights, from pixel to pixel, and the seed of the noise.
    """

    rate_drift: float = 0.0
    tif_width: float = 0.0
    offset_x_mm: float = 0.0
    offset_y_mm: float = 0.0
    rotation_rad: float = 0.0
    lag_x_s: float = 0.0
    lag_y_s: float = 0.0
    height_noise_nm: float = 0.0
    noise_seed: int = 0


@dataclass(frozen=True)
class Situation:
    """What a plan says of a run, small enough to be sent to every worker."""

    surface: SurfaceMap
    influence: InfluenceFunction
    program: PvtProgram
    clear_aperture: NDArray[np.bool_]
    options: PlanOptions


@dataclass(frozen=True)
class _Motion:
    """Points along the executed cubics on the machine; at each the velocity and the share of the run so far."""

    points: MotionPoints
    vx_mm_s: FloatArray
    vy_mm_s: FloatArray
    elapsed: FloatArray


def situation_of(plan: Plan) -> Situation | None:
    """Return what is needed of a plan; None where it is a mere schedule."""
    if plan.surface is None or plan.influence is None or plan.prediction is None:
        return None
    return Situation(plan.surface, plan.influence, plan.program, plan.prediction.clear_aperture, plan.options)


def residuals(situation: Situation, draws: list[Draw]) -> FloatArray:
    """Return RMS and PV of the residual in nm, (n, 2), for every draw."""
    influence = seen_on_part(situation.influence, situation.options.placement)
    target = Target.of(situation.surface, influence, situation.clear_aperture, situation.options)
    motion = _motion(situation)
    x_mm, y_mm = pixels_of(situation.surface, situation.clear_aperture)
    centre_mm = float(x_mm.mean()), float(y_mm.mean())
    grid = grid_of(situation.surface)
    found = np.empty((len(draws), 2))
    for index, draw in enumerate(draws):
        place_mm = _place_mm(motion, situation.options.placement, centre_mm, draw)
        time_s = motion.points.time_s * (1 + draw.rate_drift * motion.elapsed)
        removal_nm = removal_of_samples(grid, _widened(influence, draw.tif_width), *place_mm, time_s.ravel())
        left_nm = target.residual_nm(removal_nm)
        if draw.height_noise_nm:
            noise = np.random.default_rng(draw.noise_seed).standard_normal(left_nm.size)
            left_nm += target.levelling(draw.height_noise_nm * noise)
        found[index] = rms(left_nm), peak_to_valley(left_nm)
    return found


def _place_mm(
    motion: _Motion, placement: Placement, centre_mm: tuple[float, float], draw: Draw
) -> tuple[FloatArray, FloatArray]:
    """Where on the part the tool is, (n,) each: behind on its axes, and the part not where it should lie."""
    points = motion.points
    x_mm, y_mm = placement.inverse(
        (points.x_mm - draw.lag_x_s * motion.vx_mm_s).ravel(), (points.y_mm - draw.lag_y_s * motion.vy_mm_s).ravel()
    )
    x_mm, y_mm = x_mm - draw.offset_x_mm - centre_mm[0], y_mm - draw.offset_y_mm - centre_mm[1]
    cosine, sine = np.cos(draw.rotation_rad), np.sin(draw.rotation_rad)
    return centre_mm[0] + cosine * x_mm + sine * y_mm, centre_mm[1] - sine * x_mm + cosine * y_mm


def _widened(influence: InfluenceFunction, width: float) -> InfluenceFunction:
    if not width:
        return influence
    factor = np.exp(width)
    return InfluenceFunction(influence.rate_nm_s / factor**2, float(influence.pixel_mm * factor))


def _motion(situation: Situation) -> _Motion:
    program = situation.program
    points = max(PREDICTION_POINTS, points_per_segment(program, situation.influence))
    motion = motion_points(program, points)
    tau_s = 0.5 * (np.polynomial.legendre.leggauss(points)[0] + 1) * program.time_s[:, None]
    velocity_mm_s = {}
    for coordinate in ("x", "y"):
        axis = program.axis_of(coordinate)
        velocity_mm_s[coordinate] = axis_cubics(program, axis).velocity(tau_s) / axis.counts_per_mm
    elapsed_s = tau_s + (np.cumsum(program.time_s) - program.time_s)[:, None]
    return _Motion(motion, velocity_mm_s["x"], velocity_mm_s["y"], elapsed_s / program.total_time_s)
