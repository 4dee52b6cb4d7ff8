"""A short soak: the day of `make soak` in small."""

from __future__ import annotations

import pytest

from benchmarks._soak import LISTENERS, growth, soak

DURATION_S, SPEED = 4 * 3600.0, 200.0
MEMORY_GROWTH, LEAST_MARGIN_RATIO = 0.05, 0.8


@pytest.mark.slow
def test_runs_back_to_back_cost_neither_memory_nor_margin() -> None:
    seen = soak(DURATION_S, SPEED)
    assert set(seen.states) == {"completed"}
    assert len(seen.states) * seen.motion_s >= DURATION_S
    assert growth(seen.service_mib) < MEMORY_GROWTH
    assert growth(seen.emulator_mib) < MEMORY_GROWTH
    assert 1 + growth(seen.margins_s) > LEAST_MARGIN_RATIO
    assert seen.listening == LISTENERS
