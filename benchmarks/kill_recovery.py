"""Workers and services killed at random moments: what is known afterwards, against the emulator's own trace."""

from __future__ import annotations

import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

from benchmarks._killing import Verdict, try_out

TRIALS, BATCH = 200, 20
SERVED = (3, 6, 9)
SIDE_BY_SIDE = 2
"""Batches at a time, each on an emulated controller of its own; most of a trial is waiting for its motion."""


def run() -> dict[str, Any]:
    """Kill 200 times; in three of ten batches the service, with the worker or without."""
    verdicts: list[Verdict] = []
    spawned = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(SIDE_BY_SIDE, mp_context=spawned) as pool:
        for batch in pool.map(partial(_batch, BATCH), range(TRIALS // BATCH)):
            verdicts += batch
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


def _batch(trials: int, number: int) -> list[Verdict]:
    return try_out(trials, seed=number, served=number in SERVED)
