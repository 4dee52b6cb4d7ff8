"""The public flat, Gaussian tool of 0.4 nm/s and 2.8 mm FWHM, no machine limits: residual and beam time."""

from __future__ import annotations

from typing import Any

from benchmarks._flat import SLOW, flat, peers, without_limits


def run() -> dict[str, Any]:
    """Solve the dwell times once, and by the peers; figures without "here" in their name are published ones."""
    surface = flat()
    return {
        "metrics": without_limits(surface, SLOW),
        "targets": {"rms_nm": {"max": 0.303}, "dwell_s": {"max": 4900.0}},
        "peers": peers(surface, SLOW)
        | {
            "rifta_rms_nm": 0.310,
            "rifta_dwell_s": 27_023.0,
            "iterative_rifta_rms_nm": 0.314,
            "iterative_rifta_dwell_s": 11_136.0,
            "bound_rms_nm": 0.302,
            "bound_dwell_s": 4807.0,
        },
    }
