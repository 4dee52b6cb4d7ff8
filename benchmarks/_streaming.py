"""Jobs and runs for the streaming benchmarks."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

from ibfctl.errors import RunError
from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import AxisLetter, MachineDescription, read_machine
from ibfctl.machine.program import AxisProgram, PvtProgram
from ibfctl.machine.shipped import shipped_machine
from ibfctl.runs.drivers import connect
from ibfctl.runs.emulator import emulated_controller
from ibfctl.runs.outcome import RunOutcome
from ibfctl.runs.streamer import execute


def machine() -> MachineDescription:
    """Return the shipped machine of the emulated controller."""
    return read_machine(shipped_machine("simulator"))


def wave(segments: int, time_samples: int) -> PvtProgram:
    """Return a smooth two-axis motion of that many segments, at rest at both ends."""
    bench = machine()
    phase = np.linspace(0, 1, segments + 1)
    axes: dict[str, AxisProgram] = {}
    turns: dict[AxisLetter, float] = {"A": segments / 200, "B": 3.0}
    for letter, waves in turns.items():
        position = np.rint(100_000 * np.sin(np.pi * phase) ** 2 * np.sin(2 * np.pi * waves * phase))
        slope = np.gradient(position, time_samples * bench.sample_period_s)
        slope[[0, -1]] = 0
        increments, velocities = np.diff(position).astype(np.int64), np.rint(slope[1:]).astype(np.int64)
        axes[letter] = AxisProgram(increments, velocities, 0, bench.axes[letter].signed_counts_per_mm)
    times = np.full(segments, time_samples, dtype=np.int64)
    return PvtProgram(axes, {"x": "A", "y": "B"}, times, bench.sample_period_s)


def stream(
    program: PvtProgram,
    speed: float,
    faults: tuple[str, ...] = (),
    prepare: Callable[[MotionController], None] = lambda _: None,
) -> RunOutcome | None:
    """Run a program on a fresh emulated controller; None if the run ended otherwise than as planned."""
    with emulated_controller(None, speed=speed, faults=faults) as emulated:
        here = emulated.in_place_of(machine())
        controller = connect(here)
        prepare(controller)
        try:
            return execute(program, here, controller, time_scale=speed)
        except RunError as error:
            print(f"  speed {speed:.4g}: {error}", file=sys.stderr)
            return None
        finally:
            controller.close()
