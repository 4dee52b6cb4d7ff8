from __future__ import annotations

import pytest

from ibfctl.errors import EstoppedError, RunError
from ibfctl.machine.controller import BufferStatus
from ibfctl.runs.counts import LASTING_POLLS, CountCheck

RUNNING, COMPLETE = 30, 31


def poll(a: int, b: int, sent: int, code: int = RUNNING, *, active: int = 1, guard_runs: bool = True) -> BufferStatus:
    executed = {"A": a, "B": b}
    free = {letter: 255 - (sent - count - active) for letter, count in executed.items()}
    codes, positions = {"A": code, "B": code}, {"A": 0, "B": 0}
    return BufferStatus(
        free, executed, codes, guard_runs, "", time_samples=0, position_counts=positions, gate_open=True
    )


def test_counts_that_agree_pass() -> None:
    check = CountCheck(255, RUNNING, COMPLETE)
    for executed in range(100):
        check(poll(executed, executed, sent=200), 200, end_sent=False)


def test_a_count_read_a_moment_later_may_be_one_ahead_now_and_then() -> None:
    check = CountCheck(255, RUNNING, COMPLETE)
    for executed in range(100):
        check(poll(executed, executed + executed % 2, sent=200), 200, end_sent=False)


def test_a_lasting_difference_of_one_is_a_lost_segment() -> None:
    check = CountCheck(255, RUNNING, COMPLETE)
    for executed in range(LASTING_POLLS):
        check(poll(executed, executed + 1, sent=200), 200, end_sent=False)
    with pytest.raises(RunError, match="no longer execute the same segment"):
        check(poll(LASTING_POLLS, LASTING_POLLS + 1, sent=200), 200, end_sent=False)


def test_a_difference_of_two_is_a_fault_at_once() -> None:
    with pytest.raises(RunError, match=r"A 10, B 12"):
        CountCheck(255, RUNNING, COMPLETE)(poll(10, 12, sent=200), 200, end_sent=False)


def test_counts_never_go_back() -> None:
    check = CountCheck(255, RUNNING, COMPLETE)
    check(poll(10, 10, sent=200), 200, end_sent=False)
    with pytest.raises(RunError, match="lost or made up"):
        check(poll(9, 9, sent=200), 200, end_sent=False)


@pytest.mark.parametrize("active", [-1, 3])
def test_what_was_sent_is_executed_or_waiting_or_in_motion(active: int) -> None:
    with pytest.raises(RunError, match="lost or made up"):
        CountCheck(255, RUNNING, COMPLETE)(poll(10, 10, sent=200, active=active), 200, end_sent=False)


def test_a_segment_that_stays_missing_was_lost() -> None:
    check = CountCheck(255, RUNNING, COMPLETE)
    for executed in range(LASTING_POLLS):
        check(poll(executed, executed, sent=200, active=2), 200, end_sent=False)
    with pytest.raises(RunError, match="lost or made up"):
        check(poll(LASTING_POLLS, LASTING_POLLS, sent=200, active=2), 200, end_sent=False)


def test_complete_is_expected_only_once_the_end_marker_is_sent() -> None:
    done = poll(201, 201, sent=201, code=COMPLETE, active=0)
    CountCheck(255, RUNNING, COMPLETE)(done, 200, end_sent=True)
    with pytest.raises(RunError, match="stopped with code 31"):
        CountCheck(255, RUNNING, COMPLETE)(done, 201, end_sent=False)


def test_an_empty_buffer_has_its_own_hint() -> None:
    with pytest.raises(RunError, match="the buffer ran empty"):
        CountCheck(255, RUNNING, COMPLETE)(poll(10, 10, sent=200, code=32), 200, end_sent=False)


@pytest.mark.parametrize("code", [6, 11, 15])
def test_an_emergency_stop_is_named_even_where_the_guard_has_seen_it_first(code: int) -> None:
    with pytest.raises(EstoppedError, match=f"code {code}"):
        CountCheck(255, RUNNING, COMPLETE)(poll(10, 10, sent=200, code=code, guard_runs=False), 200, end_sent=False)


def test_a_guard_that_has_acted_ends_the_run() -> None:
    with pytest.raises(RunError, match="the guard on the controller closed the gate"):
        CountCheck(255, RUNNING, COMPLETE)(poll(10, 10, sent=200, guard_runs=False), 200, end_sent=False)
