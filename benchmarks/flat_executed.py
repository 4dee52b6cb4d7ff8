"""The public flat with both Gaussian tools, as executed on a 0.5 mm raster within the published stages' limits."""

from __future__ import annotations

import time
from typing import Any

from benchmarks._flat import APERTURE, FAST, SLOW, SPACING_MM, flat, without_limits
from ibfctl.machine.description import read_machine
from ibfctl.machine.shipped import shipped_machine
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.planner import make_plan


def run() -> dict[str, Any]:
    """Plan both jobs with motion in the loop, and set them against the same jobs without limits."""
    surface, machine = flat(), read_machine(shipped_machine("nsls2-ibf"))
    metrics: dict[str, float] = {}
    for name, tool in (("fast", FAST), ("slow", SLOW)):
        options = PlanOptions(clear_aperture=APERTURE, pitch_mm=SPACING_MM, step_mm=SPACING_MM, aim=tool.aim)
        begin = time.perf_counter()
        plan = make_plan(surface, tool.influence(surface.pixel_mm), machine, options)
        planning_s = time.perf_counter() - begin
        free, figures = without_limits(surface, tool), plan.summary()
        rms_nm = float(figures["executed_rms_nm"])  # type: ignore[arg-type]
        metrics |= {
            f"{name}_rms_nm": rms_nm,
            f"{name}_time_s": plan.program.total_time_s,
            f"{name}_planning_s": planning_s,
            f"{name}_rms_ratio": rms_nm / free["rms_nm"],
            f"{name}_time_ratio": plan.program.total_time_s / free["dwell_s"],
        }
    return {
        "metrics": metrics,
        "targets": {"fast_rms_ratio": {"max": 1.03}, "slow_rms_ratio": {"max": 1.03}},
    }
