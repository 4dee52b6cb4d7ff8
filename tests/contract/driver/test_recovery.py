"""A killed worker, and what recovery finds: against the emulated controller's own trace."""

from __future__ import annotations

import pytest

from benchmarks.kill_recovery import Verdict, try_out


def assert_right(verdicts: list[Verdict]) -> None:
    wrong = [f"{v.trial.found}, but {v.true_samples} samples, {v.removal_error_nm} nm" for v in verdicts if not v.right]
    assert wrong == []


def test_what_a_killed_worker_has_executed_is_known_to_the_sample() -> None:
    assert_right(try_out(2, seed=3))


@pytest.mark.slow
def test_wherever_a_worker_is_killed_what_it_has_executed_is_known() -> None:
    assert_right(try_out(20, seed=4))
