"""How long one sample of the controller lasts on the host's clock."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from ibfctl.errors import ControllerError

PAUSE_S = 0.001
MIN_READINGS = 8


def sample_period_s(read_counter: Callable[[], int], duration_s: float) -> float:
    """Fit a line through readings of the sample counter against the host's monotonic clock.

    A reading is worth as much as its round trip was short: the counter was read somewhere in between.

    Parameters
    ----------
    read_counter
        Asks the controller for its sample counter.
    duration_s
        How long to go on reading. One second yields some 1e-5 on a quiet local network.

    Raises
    ------
    ControllerError
        If the counter does not count upwards.
    """
    middles: list[float] = []
    trips: list[float] = []
    counts: list[int] = []
    start = time.monotonic()
    while time.monotonic() < start + duration_s or len(counts) < MIN_READINGS:
        before = time.monotonic()
        counts.append(read_counter())
        after = time.monotonic()
        middles.append((before + after) / 2 - start)
        trips.append(after - before)
        time.sleep(PAUSE_S)
    counted = np.array(counts, dtype=np.float64) - counts[0]
    if np.any(np.diff(counted) < 0) or counted[-1] <= 0:
        raise ControllerError(
            "the controller's sample counter does not count upwards", "check TM: the servo may be stopped"
        )
    # Polynomial weights multiply residuals, so 1/trip weighs squares as 1/trip².
    slope = np.polyfit(np.array(middles), counted, 1, w=1 / np.maximum(trips, np.median(trips) / 2))[0]
    return float(1 / slope)
