from __future__ import annotations

import threading
import time
from typing import cast

import pytest

from ibfctl.errors import AbortedError, ControllerError, RunError
from ibfctl.machine.controller import MotionController
from ibfctl.runs.sentinel import Sentinel

SOON_S = 5.0


class Gate:
    """A controller that has only a gate and an abort."""

    def __init__(self, fails: Exception | None = None) -> None:
        self.closed, self.aborted = threading.Event(), threading.Event()
        self._fails = fails

    def close_gate(self) -> None:
        self.closed.set()
        if self._fails:
            raise self._fails

    def abort(self) -> None:
        self.aborted.set()


def sentinel_over(gate: Gate, abort: threading.Event) -> Sentinel:
    return Sentinel(cast(MotionController, gate), abort)


def test_it_does_nothing_while_all_is_well() -> None:
    gate = Gate()
    with sentinel_over(gate, threading.Event()) as sentinel:
        sentinel.expect_by(time.monotonic() + 3600, "late")
        sentinel.check()
    assert not gate.closed.is_set()
    assert not gate.aborted.is_set()


def test_a_missed_deadline_closes_the_gate_and_is_an_error() -> None:
    gate = Gate()
    with sentinel_over(gate, threading.Event()) as sentinel:
        sentinel.expect_by(time.monotonic(), "late")
        assert gate.closed.wait(SOON_S)
        with pytest.raises(RunError, match="late; the beam gate was closed first"):
            sentinel.check()


def test_a_deadline_without_fault_only_closes_the_gate() -> None:
    gate = Gate()
    with sentinel_over(gate, threading.Event()) as sentinel:
        sentinel.expect_by(time.monotonic(), fault=None)
        assert gate.closed.wait(SOON_S)
        assert sentinel.error() is None


def test_abort_aborts_whatever_this_thread_does() -> None:
    gate, abort = Gate(), threading.Event()
    with sentinel_over(gate, abort) as sentinel:
        abort.set()
        assert gate.aborted.wait(SOON_S)
        with pytest.raises(AbortedError):
            sentinel.check()


def test_abort_still_works_after_a_gate_that_would_not_close() -> None:
    gate, abort = Gate(fails=ControllerError("no")), threading.Event()
    with sentinel_over(gate, abort) as sentinel:
        sentinel.expect_by(time.monotonic(), "late")
        assert gate.closed.wait(SOON_S)
        abort.set()
        assert gate.aborted.wait(SOON_S)


def test_a_sentinel_that_fails_ends_the_run_and_still_hears_an_abort() -> None:
    gate, abort = Gate(fails=ZeroDivisionError("bug")), threading.Event()
    with sentinel_over(gate, abort) as sentinel:
        sentinel.expect_by(time.monotonic(), fault=None)
        assert gate.closed.wait(SOON_S)
        abort_after = time.monotonic() + SOON_S
        while sentinel.error() is None and time.monotonic() < abort_after:
            pass
        with pytest.raises(RunError, match=r"sentinel failed.*bug"):
            sentinel.check()
        abort.set()
        assert gate.aborted.wait(SOON_S)
