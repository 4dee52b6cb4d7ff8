"""A day of the machine: back-to-back runs through the service under 50 listeners; run by `make soak`."""

from __future__ import annotations

from typing import Any

from benchmarks._soak import LISTENERS, growth, soak

DURATION_S = 24 * 3600.0
SPEED = 300.0
MEMORY_GROWTH = 0.05
LEAST_MARGIN_RATIO = 0.8


def run() -> dict[str, Any]:
    """Run for a day of the emulated controller; margins are compared as seconds of the host."""
    seen = soak(DURATION_S, SPEED)
    metrics = {
        "motion_h": len(seen.states) * seen.motion_s / 3600,
        "runs": len(seen.states),
        "not_completed": sum(state != "completed" for state in seen.states),
        "service_growth": growth(seen.service_mib),
        "emulator_growth": growth(seen.emulator_mib),
        "service_mib": seen.service_mib[-1],
        "margin_ratio": 1 + growth(seen.margins_s),
        "least_margin_s": min(seen.margins_s) / SPEED,
        "listening": seen.listening,
        "wall_s": seen.wall_s,
    }
    targets = {
        "motion_h": {"min": DURATION_S / 3600},
        "not_completed": {"max": 0},
        "service_growth": {"max": MEMORY_GROWTH},
        "emulator_growth": {"max": MEMORY_GROWTH},
        "margin_ratio": {"min": LEAST_MARGIN_RATIO},
        "listening": {"min": LISTENERS},
    }
    return {"metrics": metrics, "targets": targets}
