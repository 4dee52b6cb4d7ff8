"""Shortest segments that are sustained for a minute in real time with 5 ms reply latency."""

from __future__ import annotations

from typing import Any

from benchmarks._streaming import stream, wave

LATENCY = "delay seconds=0.005"
DURATION_S = 60.0
TIMES_SAMPLES = (2, 4, 6, 8)


def run() -> dict[str, Any]:
    """Lengthen the segments until a minute passes without an underrun; the controller knows no odd times."""
    targets = {"segment_ms": {"max": 4.0}}
    for time_samples in TIMES_SAMPLES:
        segment_s = time_samples / 1024
        outcome = stream(wave(int(DURATION_S / segment_s), time_samples), speed=1.0, faults=(LATENCY,))
        if outcome is not None:
            metrics = {
                "segment_ms": segment_s * 1e3,
                "minimum_margin_ms": outcome.minimum_buffer_margin_s * 1e3,
                "duration_s": outcome.duration_s,
            }
            return {"metrics": metrics, "targets": targets}
    return {"metrics": {"segment_ms": float("inf")}, "targets": targets}
