"""Mazes with rounded corners: executed residual and peak acceleration beside sharp corners in the same time.

The map, tool and stages are those of `maze_vs_paper`; the corners are rounded with 5 % of the pitch. Both kinds of
corners are planned with motion in the loop. At residuals of some hundredths of a nanometre the ratio scatters by a
tenth from maze to maze: the mean over some seeds counts, and of the accelerations the worst of all axes and seeds.
"""

from __future__ import annotations

from typing import Any

from benchmarks.maze_vs_paper import (
    HALF_X_MM,
    HALF_Y_MM,
    PIXEL_MM,
    TIF_FWHM_MM,
    TIF_PEAK_NM_S,
    TIF_RADIUS_MM,
    made_map,
)
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import Smoothing
from ibfctl.planning.planner import make_plan
from ibfctl.surface.influence import InfluenceFunction, gaussian
from ibfctl.surface.map import Rectangle

PITCH_MM, SEEDS = 0.5, 10
TOLERANCE_MM = 0.05 * PITCH_MM


def run() -> dict[str, Any]:
    """Plan some mazes, each with rounded and, for the comparison that the plan itself makes, with sharp corners."""
    machine, influence = read_machine(shipped_machine("nsls2-ibf")), _tool()
    rounded_nm, sharp_nm, accelerations, times, deviations_mm = [], [], [], [], []
    for seed in range(SEEDS):
        options = PlanOptions(
            path="maze",
            pitch_mm=PITCH_MM,
            seed=seed,
            clear_aperture=Rectangle(-HALF_X_MM, HALF_X_MM, -HALF_Y_MM, HALF_Y_MM),
            corner_tolerance_mm=TOLERANCE_MM,
        )
        plan = make_plan(made_map(), influence, machine, options)
        found, beside = plan.summary(), plan.smoothing
        assert isinstance(beside, Smoothing)
        assert plan.certificate.passed
        rounded_nm.append(float(str(found["executed_rms_nm"])))
        sharp_nm.append(beside.sharp_executed_rms_nm)
        peaks: dict[str, float] = found["peak_acceleration_mm_s2"]  # type: ignore[assignment]
        accelerations += [peak / beside.sharp_peak_acceleration_mm_s2[letter] for letter, peak in peaks.items()]
        times.append(plan.program.total_time_s / beside.sharp_total_time_s)
        deviations_mm.append(beside.deviation_mm)
    return {
        "metrics": {
            "residual_ratio": sum(rounded_nm) / sum(sharp_nm),
            "acceleration_ratio": max(accelerations),
            "time_ratio": max(times),
            "deviation_mm": max(deviations_mm),
            "rounded_rms_nm": sum(rounded_nm) / SEEDS,
            "sharp_rms_nm": sum(sharp_nm) / SEEDS,
        },
        "targets": {
            "residual_ratio": {"max": 1.0},
            "acceleration_ratio": {"max": 0.6},
            "time_ratio": {"max": 1.005},
            "deviation_mm": {"max": TOLERANCE_MM},
        },
    }


def _tool() -> InfluenceFunction:
    return gaussian(TIF_FWHM_MM, TIF_PEAK_NM_S, TIF_RADIUS_MM, PIXEL_MM)
