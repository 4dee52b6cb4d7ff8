import itertools

import pytest

from ibfctl.errors import RunError
from ibfctl.runs.states import TERMINAL, TRANSITIONS, RunState, check

USUAL = ["queued", "preflight", "moving_to_start", "armed", "running", "finishing", "completed"]
WITH_PAUSE = ["running", "pausing", "paused", "resuming", "running"]
ENDS = {"stopped", "aborted", "faulted", "estopped"}


@pytest.mark.parametrize("way", [USUAL, WITH_PAUSE, ["running", "interrupted", "resuming", "running"]])
def test_what_a_run_does_is_allowed(way: list[str]) -> None:
    for old, new in itertools.pairwise(way):
        check(RunState(old), RunState(new))


def test_every_pair_that_the_table_does_not_hold_is_refused() -> None:
    for old in RunState:
        for new in set(RunState) - TRANSITIONS[old]:
            with pytest.raises(RunError, match=f"a run that is {old} cannot become {new}"):
                check(old, new)


def test_any_state_of_a_living_run_may_end_in_every_way_but_only_a_finishing_one_completes() -> None:
    living = set(RunState) - TERMINAL - {RunState.INTERRUPTED}
    for state in living:
        assert ENDS | {"interrupted"} <= TRANSITIONS[state]
    assert [state for state in RunState if RunState.COMPLETED in TRANSITIONS[state]] == ["finishing"]
    assert {"completed", *ENDS} == TERMINAL
