from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.programs import program

from ibfctl.runs.ledger import SegmentLedger

SECONDS = np.array([1024, 2048, 512, 512, 1024])  # 1, 2, 0.5, 0.5 and 1 s


@pytest.fixture
def ledger() -> SegmentLedger:
    made = SegmentLedger(replace(program(5), time_samples=SECONDS), time_scale=2.0)
    made.add(3, now=0.0)
    made.begin(now=100.0)
    return made


def test_at_the_beginning_all_that_was_sent_is_left(ledger: SegmentLedger) -> None:
    assert ledger.margin_s(100.0) == pytest.approx(3.5)
    assert ledger.dry_at == pytest.approx(100.0 + 3.5 / 2)


def test_the_margin_runs_down_on_the_host_clock(ledger: SegmentLedger) -> None:
    assert ledger.margin_s(101.0) == pytest.approx(1.5)
    assert ledger.margin_s(102.0) < 0


def test_of_the_segment_in_motion_nothing_is_counted_as_left(ledger: SegmentLedger) -> None:
    ledger.count(1, asked_at=100.6, answered_at=100.7)
    assert ledger.dry_at == pytest.approx(100.6 + 0.5 / 2)


def test_the_least_margin_is_the_one_before_new_segments_came(ledger: SegmentLedger) -> None:
    ledger.add(1, now=101.0)
    assert ledger.minimum_margin_s == pytest.approx(1.5)
    assert ledger.margin_s(101.0) == pytest.approx(2.0)


def test_a_count_that_stands_still_does_not_put_the_end_off(ledger: SegmentLedger) -> None:
    ledger.count(2, asked_at=101.0, answered_at=101.1)
    end = ledger.latest_end_at
    assert end == pytest.approx(101.1 + 2.0 / 2)
    ledger.count(2, asked_at=109.0, answered_at=109.1)
    assert ledger.latest_end_at == end
    ledger.count(3, asked_at=110.0, answered_at=110.1)
    assert ledger.latest_end_at == pytest.approx(110.1 + 1.5 / 2)


def test_the_end_marker_counts_as_no_segment(ledger: SegmentLedger) -> None:
    ledger.add(2, now=100.5)
    ledger.count(6, asked_at=102.5, answered_at=102.5)
    assert ledger.executed == 5
    assert ledger.dry_at == pytest.approx(102.5)


def test_lag_is_what_the_counts_cannot_explain(ledger: SegmentLedger) -> None:
    ledger.count(0, asked_at=100.4, answered_at=100.4)
    assert ledger.behind_s(100.4) < 0
    ledger.count(0, asked_at=103.0, answered_at=103.0)
    assert ledger.behind_s(103.0) == pytest.approx(3.0 - 0.5)


def test_no_more_is_sent_than_is_wanted_ahead(ledger: SegmentLedger) -> None:
    assert ledger.within(0.0, 0) == 0
    assert ledger.within(3.0, 0) == 2
    assert ledger.within(3.4, 0) == 2
    assert ledger.within(100.0, 0) == 5
    assert ledger.within(0.5, 4) == 4, "a buffer of long segments still holds a few"
    ledger.count(3, asked_at=101.8, answered_at=101.8)
    assert ledger.within(0.5, 0) == 4


def test_a_program_may_change_behind_what_was_sent(ledger: SegmentLedger) -> None:
    ledger.count(2, asked_at=101.0, answered_at=101.0)
    ledger.replace(replace(program(4), time_samples=np.array([1024, 2048, 512, 2048])))
    assert ledger.dry_at == pytest.approx(101.0)
    ledger.add(1, now=101.0)
    assert ledger.dry_at == pytest.approx(101.0 + 2.0 / 2)
    ledger.count(2, asked_at=101.1, answered_at=101.1)
    assert ledger.latest_end_at == pytest.approx(101.1 + 2.5 / 2)
