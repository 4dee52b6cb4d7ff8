"""The thread that closes the gate when the rest of the run cannot: on abort, and before the buffer is dry."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from ibfctl.errors import AbortedError, ControllerError, RunError
from ibfctl.machine.controller import MotionController

TICK_S = 0.02

_log = logging.getLogger(__name__)


class Sentinel:
    """Watch over a run from a thread of its own, on the controller's gate and abort handles.

    The streaming thread may hang in a reply that does not come, or be starved. The sentinel needs neither
    that thread nor its handles: when the deadline it was given passes without a new one, it closes the
    gate; when `abort` is set, it aborts at once.

    Parameters
    ----------
    controller
        Its `close_gate` and `abort` are called from the sentinel's thread.
    abort
        Event that anybody may set.
    """

    def __init__(self, controller: MotionController, abort: threading.Event) -> None:
        self._controller = controller
        self._abort = abort
        self._deadline = math.inf
        self._fault: str | None = None
        self._missed: str | None = None
        self._finished = False
        self._thread = threading.Thread(target=self._watch, name="run-sentinel", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._finished = True
        self._thread.join()

    def expect_by(self, deadline: float, fault: str | None) -> None:
        """Close the gate at `deadline` (monotonic clock) unless told otherwise before.

        With a `fault` the run must then end with an error; without, closing is all that is due.
        """
        self._fault = fault
        self._deadline = deadline

    def error(self) -> RunError | None:
        """Return the error that the run must end with, if the sentinel has had to act."""
        if self._abort.is_set():
            return AbortedError("run aborted on request; the beam gate is closed")
        if self._missed is not None:
            return RunError(
                f"{self._missed}; the beam gate was closed first",
                "ease the host's load or its network, then plan the part that is left",
            )
        return None

    def check(self) -> None:
        """Raise the error that the run must end with, if the sentinel has had to act."""
        error = self.error()
        if error is not None:
            raise error

    def _watch(self) -> None:
        aborted = False
        while not self._finished:
            pause_s = min(max(self._deadline - time.monotonic(), 0.0), TICK_S)
            if aborted:
                time.sleep(TICK_S)
            elif self._abort.wait(pause_s):
                aborted = True
                self._act(self._controller.abort)
            elif time.monotonic() >= self._deadline:
                self._missed, self._deadline = self._fault, math.inf
                self._act(self._controller.close_gate)

    def _act(self, action: Callable[[], None]) -> None:
        try:
            action()
        except ControllerError as error:  # the streaming thread, on its way out, tries again and reports
            _log.error("%s", error)
        except Exception as error:  # no run goes on without its sentinel
            self._missed = f"the sentinel failed: {error!r}"
            _log.exception("the sentinel failed")
