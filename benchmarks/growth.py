"""Growth of planning time: pixels and dwell points of a square job doubled twice, motion in the loop."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from benchmarks._planning import plan_made

PIXELS, POINTS, DOUBLINGS, REPEATS = 512, 25_000, 2, 2


def run() -> dict[str, Any]:
    """Plan every size, the smallest first; of repeated plannings the quickest counts."""
    seconds = {}
    plan_made(PIXELS // 2, POINTS // 16, loop=True)  # imports and caches
    for doubling in range(DOUBLINGS + 1):
        pixels = round(PIXELS * math.sqrt(2**doubling))
        repeats = REPEATS if doubling < DOUBLINGS else 1
        tried = [plan_made(pixels, POINTS * 2**doubling, loop=True) for _ in range(repeats)]
        seconds[tried[0].points] = min(planned.planning_s for planned in tried)
    ratios = [later / earlier for earlier, later in pairwise(seconds.values())]
    return {
        "metrics": {
            "ratio_per_doubling": max(ratios),
            "mean_ratio_per_doubling": math.prod(ratios) ** (1 / DOUBLINGS),
            **{f"planning_{points}_points_s": value for points, value in seconds.items()},
        },
        "targets": {"ratio_per_doubling": {"max": 2.3}},
    }
