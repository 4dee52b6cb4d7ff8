"""The thread that tells the guard on the controller that this host lives, and sees that the guard does."""

from __future__ import annotations

import logging
import threading
import time
from types import TracebackType
from typing import Self

from ibfctl.errors import ControllerError
from ibfctl.machine.controller import MotionController

INTERVAL_S = 0.1
LEAST_PAUSE_S = 0.01

_log = logging.getLogger(__name__)


class Pulse:
    """Gives signs of life, however long the stream's replies take.

    It says nothing of the rest of the run, which the `Sentinel` watches: it ends with the process, and so does what the
    guard allows. Where the guard itself has gone, as after an `AB` of somebody else, it closes the gate; why that was,
    the stream finds out.

    Parameters
    ----------
    controller
        Its `sign_of_life` is called from a thread of its own.
    guarded
        Set while a guard of ours runs.
    """

    def __init__(self, controller: MotionController, guarded: threading.Event) -> None:
        self._controller = controller
        self._guarded = guarded
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="run-pulse", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def _beat(self) -> None:
        next_at = 0.0
        while not self._over.wait(max(next_at - time.monotonic(), LEAST_PAUSE_S)):
            next_at = time.monotonic() + INTERVAL_S
            if not self._guarded.is_set():
                continue
            try:
                if not self._controller.sign_of_life() and self._guarded.is_set():
                    self._controller.close_gate()
            except ControllerError as error:  # the guard acts on the silence, and the stream is told of that
                _log.warning("no more signs of life: %s", error)
                return
