"""A map of 1024 x 1024 pixels with 100 000 dwell points, motion in the loop: time and memory of planning."""

from __future__ import annotations

from typing import Any

from benchmarks._planning import plan_apart


def run() -> dict[str, Any]:
    """Plan once, in a process of its own."""
    planned = plan_apart(1024, 100_000, loop=True)
    return {
        "metrics": planned.metrics(),
        "targets": {"planning_s": {"max": 25.0}, "peak_gib": {"max": 2.0}, "failed_checks": {"max": 0}},
    }
