"""PV segments per second that two axes are fed in steady state, over loopback, without an underrun.

`segments_per_s` counts the time spent on polling and sending, as the streamer does both, and not the time spent
waiting for room. `sustained_per_s` is the highest rate of which the emulated controller executed three seconds'
worth while it was fed: at 20 000 segments/s its 255 places hold 25 ms, so that figure is the scheduler's as well.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from benchmarks._streaming import stream, wave
from ibfctl.machine.controller import MotionController

TIME_SAMPLES = 8
STEADY_S = 3.0
RATES_PER_S = (32_000, 26_000, 21_000, 16_000, 12_000, 8_000, 4_000)
ATTEMPTS = 3

P = ParamSpec("P")
T = TypeVar("T")


class _Stopwatch:
    """Adds up the time that calls of a controller's methods take."""

    def __init__(self) -> None:
        self.busy_s = 0.0

    def attach(self, controller: MotionController) -> None:
        for name in ("buffer_status", "queue_segments"):
            setattr(controller, name, self._timed(getattr(controller, name)))

    def _timed(self, call: Callable[P, T]) -> Callable[P, T]:
        def timed(*arguments: P.args, **named: P.kwargs) -> T:
            started = time.perf_counter()
            try:
                return call(*arguments, **named)
            finally:
                self.busy_s += time.perf_counter() - started

        return timed


def run() -> dict[str, Any]:
    """Ask for ever lower rates until one is sustained; a segment of each axis counts as one."""
    targets = {"segments_per_s": {"min": 20_000}}
    for rate in RATES_PER_S:
        program = wave(int(rate / 2 * STEADY_S), TIME_SAMPLES)
        speed = rate / 2 * TIME_SAMPLES * program.sample_period_s
        for _ in range(ATTEMPTS):
            watch = _Stopwatch()
            outcome = stream(program, speed, prepare=watch.attach)
            if outcome is not None:
                metrics = {
                    "segments_per_s": 2 * outcome.segments_executed / watch.busy_s,
                    "sustained_per_s": 2 * outcome.segments_executed / (outcome.duration_s / speed),
                    "minimum_margin_ms": outcome.minimum_buffer_margin_s / speed * 1e3,
                }
                return {"metrics": metrics, "targets": targets}
    return {"metrics": {"segments_per_s": 0.0}, "targets": targets}
