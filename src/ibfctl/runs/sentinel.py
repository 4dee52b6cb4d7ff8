"""The thread that acts when the rest of the run cannot: on request, and before the buffer is dry."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from ibfctl.errors import AbortedError, ControllerError, EstoppedError, RunError, StoppedError
from ibfctl.machine.controller import MotionController
from ibfctl.runs.requests import Requests, When

TICK_S = 0.02
WHAT_IS_LEFT = "plan what is left with `ibfctl replan` from the run file of the tool, or measure the part"

_log = logging.getLogger(__name__)


class Sentinel:
    """Watch over a run from a thread of its own, on the controller's gate and abort handles.

    The streaming thread may hang in a reply that does not come, or be starved. The sentinel needs neither
    that thread nor its handles. When the deadline it was given passes without a new one, it closes the gate and then
    has the axes decelerate, while the buffer still holds motion. Of requests it carries out what cannot wait: an
    e-stop, an abort, a stop, and the gate's part of a pause at once.

    Parameters
    ----------
    controller
        Its `close_gate`, `halt`, `abort` and `estop` are called from the sentinel's thread.
    requests
        What anybody may ask of the run.
    """

    def __init__(self, controller: MotionController, requests: Requests) -> None:
        self._controller = controller
        self._requests = requests
        self._deadline = math.inf
        self._fault: str | None = None
        self._missed: str | None = None
        self._finished = False
        self._thread = threading.Thread(target=self._watch, name="run-sentinel", daemon=True)
        self.gate_shut = threading.Event()
        """Set before the gate is closed for a pause at once; cleared by whoever begins the next motion."""

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._finished = True
        self._thread.join()

    def expect_by(self, deadline: float, fault: str | None) -> None:
        """Act at `deadline` (monotonic clock) unless told otherwise before.

        With a `fault` the axes are stopped behind the closed gate, and the run must end with an error; without,
        closing the gate is all that is due.
        """
        self._fault = fault
        self._deadline = deadline

    def relax(self) -> None:
        """Expect nothing: no axis moves."""
        self._deadline = math.inf

    def error(self) -> RunError | None:
        """Return the error that the run must end with, if the sentinel has had to act."""
        wanted = wanted_end(self._requests)
        if wanted is None and self._missed is not None:
            return RunError(
                f"{self._missed}; the beam gate was closed first",
                "ease the host's load or its network, then plan the part that is left",
            )
        return wanted

    def check(self) -> None:
        """Raise the error that the run must end with, if the sentinel has had to act."""
        error = self.error()
        if error is not None:
            raise error

    def _watch(self) -> None:
        done: set[Callable[[], None]] = set()
        while not self._finished:
            act = self._wanted()
            if act is not None and act not in done:
                done.add(act)
                self._act(act)
            elif time.monotonic() >= self._deadline and not done:
                self._missed, self._deadline = self._fault, math.inf
                self._act(self._controller.close_gate if self._fault is None else self._controller.halt)
            elif self._requests.pause_wanted is When.NOW and not self.gate_shut.is_set():
                self.gate_shut.set()
                self._act(self._controller.close_gate)
            else:
                pause_s = min(max(self._deadline - time.monotonic(), 0.0), TICK_S)
                if act is None:
                    self._requests.abort.wait(pause_s)
                else:
                    time.sleep(pause_s)

    def _wanted(self) -> Callable[[], None] | None:
        """Return the gravest act that was asked for."""
        if self._requests.estop_wanted:
            return self._controller.estop
        if self._requests.abort.is_set():
            return self._controller.abort
        return self._controller.halt if self._requests.stop_wanted else None

    def _act(self, action: Callable[[], None]) -> None:
        try:
            action()
        except ControllerError as error:  # the streaming thread, on its way out, tries again and reports
            _log.error("%s", error)
        except Exception as error:  # no run goes on without its sentinel
            self._missed = f"the sentinel failed: {error!r}"
            _log.exception("the sentinel failed")


def wanted_end(requests: Requests) -> RunError | None:
    """Return the error that a run must end with because somebody has asked for its end."""
    if requests.estop_wanted:
        return EstoppedError(
            "emergency stop on request; the beam gate is closed and the motors are off",
            "it stays latched until the controller was switched off and on and homed",
        )
    if requests.abort.is_set():
        return AbortedError("run aborted on request; the beam gate is closed", WHAT_IS_LEFT)
    if requests.stop_wanted:
        return StoppedError("run stopped on request; the beam gate is closed", WHAT_IS_LEFT)
    return None
