from __future__ import annotations

import threading
import time
from typing import cast

import pytest

from ibfctl.errors import AbortedError, ControllerError, EstoppedError, RunError, StoppedError
from ibfctl.machine.controller import MotionController
from ibfctl.runs.requests import Requests, When
from ibfctl.runs.sentinel import Sentinel

SOON_S = 5.0


class Gate:
    """A controller that has only a gate and an abort."""

    def __init__(self, fails: Exception | None = None) -> None:
        self.closed, self.halted = threading.Event(), threading.Event()
        self.aborted, self.estopped = threading.Event(), threading.Event()
        self._fails = fails

    def close_gate(self) -> None:
        self.closed.set()
        if self._fails:
            raise self._fails

    def halt(self) -> None:
        self.close_gate()
        self.halted.set()

    def abort(self) -> None:
        self.aborted.set()

    def estop(self) -> None:
        self.estopped.set()


def sentinel_over(gate: Gate, abort: threading.Event | None = None) -> Sentinel:
    return requested_of(gate, Requests(abort))


def requested_of(gate: Gate, requests: Requests) -> Sentinel:
    return Sentinel(cast(MotionController, gate), requests)


def test_it_does_nothing_while_all_is_well() -> None:
    gate = Gate()
    with sentinel_over(gate, threading.Event()) as sentinel:
        sentinel.expect_by(time.monotonic() + 3600, "late")
        sentinel.check()
    assert not gate.closed.is_set()
    assert not gate.aborted.is_set()


def test_a_missed_deadline_closes_the_gate_stops_the_axes_and_is_an_error() -> None:
    gate = Gate()
    with sentinel_over(gate, threading.Event()) as sentinel:
        sentinel.expect_by(time.monotonic(), "late")
        assert gate.halted.wait(SOON_S)
        with pytest.raises(RunError, match="late; the beam gate was closed first"):
            sentinel.check()


def test_a_deadline_without_fault_only_closes_the_gate() -> None:
    gate = Gate()
    with sentinel_over(gate, threading.Event()) as sentinel:
        sentinel.expect_by(time.monotonic(), fault=None)
        assert gate.closed.wait(SOON_S)
        assert sentinel.error() is None
    assert not gate.halted.is_set()


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


def test_a_stop_and_an_emergency_stop_are_two_things() -> None:
    gate, requests = Gate(), Requests()
    with requested_of(gate, requests) as sentinel:
        requests.stop()
        assert gate.halted.wait(SOON_S)
        with pytest.raises(StoppedError):
            sentinel.check()
        requests.estop()
        assert gate.estopped.wait(SOON_S)
        with pytest.raises(EstoppedError):
            sentinel.check()
    assert not gate.aborted.is_set()


def test_a_pause_at_once_closes_the_gate_and_is_no_error() -> None:
    gate, requests = Gate(), Requests()
    with requested_of(gate, requests) as sentinel:
        requests.pause(When.SAFE_POINT)
        requests.pause(When.NOW)
        assert gate.closed.wait(SOON_S)
        assert sentinel.gate_shut.is_set()
        assert sentinel.error() is None
    assert not gate.halted.is_set()
