"""The order of the results of Ke et al. 2022 (Opt. Express 30) with its set-ups, on made surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks._tools import EXPERIMENT, SIMULATION, slopes_s_mm
from ibfctl.planning.sequence import PlanSequence


def _ideal_nm(sequence: PlanSequence) -> float:
    return float(sequence.summary()["ideal_rms_nm"])  # type: ignore[arg-type]


def _executed_nm(sequence: PlanSequence) -> float:
    return float(sequence.summary()["executed_rms_nm"])  # type: ignore[arg-type]


def _times_s(sequence: PlanSequence) -> np.ndarray:
    return np.array([plan.program.total_time_s for plan in sequence.plans])


@pytest.fixture(scope="module")
def simulated() -> dict[str, PlanSequence]:
    surface = SIMULATION.surface(2.0)
    return {method: SIMULATION.plan(surface, method) for method in ("ours", "mto", "sto")}  # type: ignore[arg-type]


def test_mto_is_far_shorter_and_smoother_than_sto(simulated: dict[str, PlanSequence]) -> None:
    # Section 4: 491 min against 2794.
    mto, sto = simulated["mto"], simulated["sto"]
    assert mto.beam_time_s < 0.7 * sto.beam_time_s
    assert all(one < other for one, other in zip(slopes_s_mm(mto), slopes_s_mm(sto), strict=True))


def test_ours_takes_no_longer_than_mto_and_leaves_no_more_than_sto(simulated: dict[str, PlanSequence]) -> None:
    ours = simulated["ours"]
    assert ours.beam_time_s <= 0.8 * simulated["mto"].beam_time_s
    assert _executed_nm(ours) <= min(_ideal_nm(simulated["sto"]), _executed_nm(simulated["sto"]))


@pytest.mark.slow
def test_the_order_of_section_4_on_fine_pixels() -> None:
    surface = SIMULATION.surface(0.5)
    mto, sto = (SIMULATION.plan(surface, method) for method in ("mto", "sto"))  # type: ignore[arg-type]
    assert mto.beam_time_s < 0.7 * sto.beam_time_s
    # Better balanced: the longest and the shortest time of a tool are closer.
    assert np.ptp(_times_s(mto)) < np.ptp(_times_s(sto))
    assert all(one < other for one, other in zip(slopes_s_mm(mto), slopes_s_mm(sto), strict=True))


def test_mto_leaves_slightly_more_than_sto_in_less_time() -> None:
    # Section 5.1: the same residual but for 0.4 nm, in a shorter time.
    surface = EXPERIMENT.surface(1.0)
    mto, sto = (EXPERIMENT.plan(surface, method) for method in ("mto", "sto"))  # type: ignore[arg-type]
    assert _ideal_nm(sto) < _ideal_nm(mto) < _ideal_nm(sto) + 0.4
    assert mto.beam_time_s < 0.9 * sto.beam_time_s


def test_the_limit_on_speed_costs_residual_and_the_loop_recovers_some() -> None:
    # Section 5: 6.9 nm with the limit, 2.1 nm without.
    surface = EXPERIMENT.surface(1.0)
    limited, free = (EXPERIMENT.plan(surface, "mto", limited=limits) for limits in (True, False))
    assert _ideal_nm(limited) > 1.5 * _ideal_nm(free)
    plain, ours = (EXPERIMENT.plan(surface, "ours", loop=loop) for loop in (False, True))
    assert _executed_nm(ours) < _executed_nm(plain) < _executed_nm(limited)
    assert ours.beam_time_s < limited.beam_time_s
