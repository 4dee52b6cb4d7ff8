"""A job of 100 000 segments on each of two axes at the highest speed: no underrun, every count exact."""

from __future__ import annotations

from typing import Any

from benchmarks._streaming import stream, wave

SEGMENTS = 100_000
TIME_SAMPLES = 60
SPEEDS = (600, 500, 400, 300, 200, 100)


def run() -> dict[str, Any]:
    """Lower the speed until the job is streamed to its end."""
    program = wave(SEGMENTS, TIME_SAMPLES)
    targets = {"segments_missing": {"max": 0}, "position_error_counts": {"max": 0}, "speed": {"min": 100}}
    for speed in SPEEDS:
        outcome = stream(program, speed)
        if outcome is not None:
            errors = outcome.final_position_error_counts.values()
            metrics = {
                "speed": float(speed),
                "segments_missing": float(SEGMENTS - outcome.segments_executed),
                "position_error_counts": float(max(map(abs, errors))),
                "minimum_margin_ms": outcome.minimum_buffer_margin_s / speed * 1e3,
                "wall_s": outcome.wall_s,
            }
            return {"metrics": metrics, "targets": targets}
    none = {"speed": 0.0, "segments_missing": float(SEGMENTS), "position_error_counts": float("nan")}
    return {"metrics": none, "targets": targets}
