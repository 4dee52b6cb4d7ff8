"""The public flat, Gaussian tool of 10 nm/s and 5 mm FWHM, no machine limits: residual and beam time."""

from __future__ import annotations

from typing import Any

from benchmarks._flat import FAST, flat, peers, without_limits


def run() -> dict[str, Any]:
    """Solve the dwell times once, and by the peers; figures without "here" in their name are published ones."""
    surface = flat()
    return {
        "metrics": without_limits(surface, FAST),
        "targets": {"rms_nm": {"max": 0.302}, "dwell_s": {"max": 110.0}, "planning_s": {"max": 1.5}},
        "peers": peers(surface, FAST)
        | {
            "rifta_rms_nm": 0.405,
            "rifta_dwell_s": 607.0,
            "iterative_rifta_rms_nm": 0.476,
            "iterative_rifta_dwell_s": 171.0,
            "converged_nnls_rms_nm": 0.3007,
            "converged_nnls_dwell_s": 107.0,
            "converged_nnls_planning_s": 45.0,
        },
    }
