"""Workers and services killed at random moments: what is known afterwards, against the emulator's own trace."""

from __future__ import annotations

import sys
from typing import Any

from benchmarks._killing import Verdict, try_out

TRIALS, BATCH = 200, 20
SERVED = (3, 6, 9)


def run() -> dict[str, Any]:
    """Kill 200 times; in three of ten batches the service, with the worker or without."""
    verdicts: list[Verdict] = []
    for batch in range(TRIALS // BATCH):
        verdicts += try_out(BATCH, seed=batch, served=batch in SERVED)
        print(f"{sum(verdict.right for verdict in verdicts)} of {len(verdicts)}", file=sys.stderr)
    return {
        "metrics": {
            "trials": len(verdicts),
            "recovered": sum(verdict.right for verdict in verdicts),
            "exposed": sum(verdict.true_samples > 0 for verdict in verdicts),
            "cut_short": sum(verdict.trial.found.can_resume and verdict.true_samples > 0 for verdict in verdicts),
            "largest_count_error": max(abs(v.trial.said_samples - v.true_samples) for v in verdicts),
            "largest_removal_error_nm": max(v.removal_error_nm for v in verdicts),
        },
        "targets": {"recovered": {"min": TRIALS}},
    }
