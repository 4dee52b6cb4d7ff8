"""The order of the results of Ke et al. 2022 (Opt. Express 30) with its set-ups, on made surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks._tools import EXPERIMENT, SIMULATION, slopes_s_mm
from ibfctl.planning.options import Aim
from ibfctl.planning.sequence import PlanSequence


def _ideal_nm(sequence: PlanSequence) -> float:
    return float(sequence.summary()["ideal_rms_nm"])  # type: ignore[arg-type]


def _executed_nm(sequence: PlanSequence) -> float:
    return float(sequence.summary()["executed_rms_nm"])  # type: ignore[arg-type]


def _times_s(sequence: PlanSequence) -> np.ndarray:
    return np.array([plan.program.total_time_s for plan in sequence.plans])


def _smoother(one: PlanSequence, other: PlanSequence) -> bool:
    """Whether each tool's dwell times (the same points for all methods) are less steep."""
    return all(here < there for here, there in zip(slopes_s_mm(one), slopes_s_mm(other), strict=True))


def _in_the_order_of_section_4(mto: PlanSequence, sto: PlanSequence) -> None:
    # 491 min against 2794: each tool longer, the narrowest most of all, at a slightly smaller residual.
    assert mto.beam_time_s < 0.4 * sto.beam_time_s
    assert _ideal_nm(sto) < _ideal_nm(mto) < 1.1 * _ideal_nm(sto)
    assert _smoother(mto, sto)
    # Better balanced: the longest and the shortest time of a tool are closer.
    assert np.ptp(_times_s(mto)) < 0.5 * np.ptp(_times_s(sto))


@pytest.fixture(scope="module")
def simulated() -> dict[str, PlanSequence]:
    surface = SIMULATION.surface(1.0)
    mto, sto = (SIMULATION.plan(surface, method) for method in ("mto", "sto"))  # type: ignore[arg-type]
    ours = SIMULATION.plan(surface, "ours", Aim(max_residual_nm=_ideal_nm(sto)))
    return {"mto": mto, "sto": sto, "ours": ours}


def test_mto_is_far_shorter_and_smoother_than_sto_and_leaves_slightly_more(simulated: dict[str, PlanSequence]) -> None:
    _in_the_order_of_section_4(simulated["mto"], simulated["sto"])


def test_ours_is_shorter_and_smoother_than_mto_and_leaves_no_more_than_sto(simulated: dict[str, PlanSequence]) -> None:
    ours, mto, sto = (simulated[method] for method in ("ours", "mto", "sto"))
    assert ours.beam_time_s <= 0.8 * mto.beam_time_s
    assert _executed_nm(ours) <= min(_ideal_nm(sto), _executed_nm(sto))
    assert _smoother(ours, mto)


@pytest.mark.slow
def test_the_order_of_section_4_on_fine_pixels() -> None:
    surface = SIMULATION.surface(0.5)
    mto, sto = (SIMULATION.plan(surface, method) for method in ("mto", "sto"))  # type: ignore[arg-type]
    _in_the_order_of_section_4(mto, sto)


def test_mto_leaves_slightly_more_than_sto_in_less_time() -> None:
    # Section 5.1: the same residual but for 0.4 nm, in a shorter time.
    surface = EXPERIMENT.surface(0.25)
    mto, sto = (EXPERIMENT.plan(surface, method) for method in ("mto", "sto"))  # type: ignore[arg-type]
    assert _ideal_nm(sto) < _ideal_nm(mto) < _ideal_nm(sto) + 0.4
    assert mto.beam_time_s < 0.7 * sto.beam_time_s


def test_the_limit_on_speed_costs_residual_and_the_loop_recovers_some() -> None:
    # Section 5: 6.9 nm with the limit, 2.1 nm without.
    surface = EXPERIMENT.surface(0.5)
    limited, free = (EXPERIMENT.plan(surface, "mto", limited=limits) for limits in (True, False))
    assert _ideal_nm(limited) > 1.5 * _ideal_nm(free)
    plain, ours = (EXPERIMENT.plan(surface, "ours", loop=loop) for loop in (False, True))
    assert _executed_nm(ours) < _executed_nm(plain) < _executed_nm(limited)
    assert ours.beam_time_s < limited.beam_time_s
