"""A map of 2048 x 2048 pixels with 400 000 dwell points, plain chain: time and memory of planning."""

from __future__ import annotations

from typing import Any

from benchmarks._planning import plan_apart


def run() -> dict[str, Any]:
    """Plan once, in a process of its own."""
    planned = plan_apart(2048, 400_000, loop=False)
    return {
        "metrics": planned.metrics(),
        "targets": {"planning_s": {"max": 120.0}, "peak_gib": {"max": 6.0}, "failed_checks": {"max": 0}},
    }
