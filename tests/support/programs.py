"""Small machines and programs for tests of the driver and of runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import AxisProgram, ContourAxis, ContourProgram, PvtProgram
from ibfctl.runs.drivers import connect

SAMPLE_S = 1 / 1024


def machine(host: str = "127.0.0.1", port: int = 5023, **connection: object) -> MachineDescription:
    limits = {"counts_per_mm": 1000, "v_max_mm_s": 250, "a_max_mm_s2": 2000}
    return MachineDescription.model_validate(
        {
            "name": "bench",
            "axes": {
                "A": {"coordinate": "x", "travel_min_mm": -100, "travel_max_mm": 100, **limits},
                "B": {"coordinate": "y", "travel_min_mm": -50, "travel_max_mm": 50, **limits},
            },
            "servo": {"position_tolerance_counts": 1, "approach_speed_mm_s": 50, "settle_timeout_s": 10},
            "homing": {"method": "absolute"},
            "beam_gate": {"output": 1, "guard_patience_s": 2.0},
            "connection": {"host": host, "port": port, "timeout_s": 2.0, **connection},
        }
    )


def program(segments: int, time_samples: int = 60, start_counts: tuple[int, int] = (-500, 250)) -> PvtProgram:
    """A smooth wave on A and a slower one on B, at rest at both ends."""
    phase = np.linspace(0, 1, segments + 1)
    ramp = np.sin(np.pi * phase) ** 2
    axes = {}
    for letter, start, turns, height in (
        ("A", start_counts[0], segments / 40, 5000),
        ("B", start_counts[1], 1, 3000),
    ):
        position = np.rint(height * ramp * np.sin(2 * np.pi * turns * phase)).astype(np.int64)
        slope = np.gradient(position, time_samples * SAMPLE_S)
        slope[[0, -1]] = 0
        axes[letter] = AxisProgram(np.diff(position), np.rint(slope[1:]).astype(np.int64), start, 1000.0)
    times = np.full(segments, time_samples, dtype=np.int64)
    return PvtProgram(axes, {"x": "A", "y": "B"}, times, SAMPLE_S)


@contextmanager
def connected(bench: MachineDescription) -> Iterator[MotionController]:
    controller = connect(bench)
    try:
        yield controller
    finally:
        controller.close()


def contour(segments: int, exponent: int = 5, start_counts: tuple[int, int] = (-500, 250)) -> ContourProgram:
    """The same motion in straight lines."""
    wave = program(segments, 2**exponent, start_counts)
    axes = {
        letter: ContourAxis(axis.increment_counts, axis.start_counts, axis.counts_per_mm)
        for letter, axis in wave.axes.items()
    }
    exponents = np.full(segments, exponent, dtype=np.int64)
    return ContourProgram(axes, wave.coordinates, exponents, wave.sample_period_s)
