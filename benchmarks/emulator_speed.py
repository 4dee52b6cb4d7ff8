"""How many times faster than real time the emulated controller can run two axes, trace included, on one core."""

from __future__ import annotations

import itertools
import math
import tempfile
import time
from pathlib import Path
from typing import Any

from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.trace import TraceWriter

SIMULATED_S = 300
SEGMENT_SAMPLES = 20
CHUNK_SAMPLES = 1024  # what passes in one tick of the server at 200 times real time
AXES = "AB"


def run() -> dict[str, Any]:
    """Stream 20-sample segments to both axes and let time pass as fast as it can."""
    with tempfile.TemporaryDirectory() as folder, TraceWriter(Path(folder) / "trace.h5", AXES, 1 / 1024) as trace:
        controller = Controller(Settings(motor_on_at_start=True), trace)
        segments = _segments(SIMULATED_S * 1024 // SEGMENT_SAMPLES)
        sent = _fill(controller, segments, 0)
        _accept(controller, "BTAB")
        begin_s = time.perf_counter()
        while controller.state.axes[0].moving:
            controller.advance(CHUNK_SAMPLES)
            sent = _fill(controller, segments, sent)
        elapsed_s = time.perf_counter() - begin_s
        stop_codes = [axis.stop_code for axis in controller.state.axes]
    if stop_codes != [31, 31]:
        raise RuntimeError(f"the profile ended with stop codes {stop_codes}")
    return {
        "metrics": {"times_real": controller.state.time / 1024 / elapsed_s, "segments": len(segments) - 1},
        "targets": {"times_real": {"min": 200}},
    }


def _segments(count: int) -> list[str]:
    """Arguments of `PV` along a wave that ends at rest, and the end marker."""
    phase = 2 * math.pi / 100
    moves = [round(1000 * (1 - math.cos(phase * k))) for k in range(count - count % 100 + 1)]
    scale = 1000 * phase * 1024 / SEGMENT_SAMPLES
    lines = [
        f"{after - before},{round(scale * math.sin(phase * (k + 1)))},{SEGMENT_SAMPLES}"
        for k, (before, after) in enumerate(itertools.pairwise(moves))
    ]
    return [*lines, "0,0,0"]


def _fill(controller: Controller, segments: list[str], sent: int) -> int:
    free = controller.state.axes[0].buffer.free
    for segment in segments[sent : sent + free]:
        for letter in AXES:
            _accept(controller, f"PV{letter}={segment}")
    return min(len(segments), sent + free)


def _accept(controller: Controller, command: str) -> None:
    if controller.reply(command, "A") != ":":
        raise RuntimeError(f"{command} was refused")
