"""The thread that tells the guard on the controller that this host lives."""

from __future__ import annotations

import logging
import threading
from types import TracebackType
from typing import Self

from ibfctl.errors import ControllerError
from ibfctl.machine.controller import MotionController

INTERVAL_S = 0.1

_log = logging.getLogger(__name__)


class Pulse:
    """Gives signs of life, however long the stream's replies take.

    It says nothing of the rest of the run, which the `Sentinel` watches: it ends with the process, and so does what the
    guard allows.

    Parameters
    ----------
    controller
        Its `sign_of_life` is called from a thread of its own.
    """

    def __init__(self, controller: MotionController) -> None:
        self._controller = controller
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
        while not self._over.wait(INTERVAL_S):
            try:
                self._controller.sign_of_life()
            except ControllerError as error:  # the guard acts on the silence, and the stream is told of that
                _log.warning("no more signs of life: %s", error)
                return
