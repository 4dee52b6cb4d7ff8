"""How far the emulated encoder is from the analytic cubic, in exact arithmetic, at every sample."""

from __future__ import annotations

import random
from fractions import Fraction
from typing import Any

from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.settings import Settings

SEGMENTS = 250
SAMPLES_PER_S = 1024


def run() -> dict[str, Any]:
    """Run random segments and compare the encoder with the Hermite form of each."""
    source = random.Random(20)
    segments = [
        (source.randint(-20_000, 20_000), source.randint(-500_000, 500_000), source.randint(2, 400))
        for _ in range(SEGMENTS)
    ]
    controller = Controller(Settings(motor_on_at_start=True))
    for move, velocity, samples in [*segments, (0, 0, 0)]:
        controller.reply(f"PVA={move},{velocity},{samples}", "A")
    controller.reply("BTA", "A")
    worst, samples_seen = Fraction(0), 0
    for exact in _exact_positions(segments):
        controller.advance(1)
        worst = max(worst, abs(controller.state.axes[0].encoder_counts - exact))
        samples_seen += 1
    if controller.state.axes[0].stop_code != 31:
        raise RuntimeError("the profile did not end")
    return {
        "metrics": {"max_error_counts": float(worst), "samples": samples_seen},
        "targets": {"max_error_counts": {"max": 0.5}},
    }


def _exact_positions(segments: list[tuple[int, int, int]]) -> list[Fraction]:
    positions, base, inherited = [], 0, 0
    for move, velocity, samples in segments:
        period = Fraction(samples, SAMPLES_PER_S)
        for sample in range(1, samples + 1):
            u = Fraction(sample, samples)
            tangents = (u**3 - 2 * u**2 + u) * inherited + (u**3 - u**2) * velocity
            positions.append(base + (3 * u**2 - 2 * u**3) * move + tangents * period)
        base, inherited = base + move, velocity
    return positions
