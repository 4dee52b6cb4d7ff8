"""What an operator or an interlock wants of a run, set from any thread and looked at by the run."""

from __future__ import annotations

import threading
from enum import StrEnum


class When(StrEnum):
    """At which place a pause begins: at the next safe point, or at once."""

    SAFE_POINT = "safe-point"
    NOW = "now"


class Requests:
    """Wishes of one run; stop, abort and e-stop are never taken back.

    Parameters
    ----------
    abort
        Event to use, so that somebody who knows nothing of runs can set it.

    Attributes
    ----------
    abort
        Gate closed and all motion ended at once.
    """

    def __init__(self, abort: threading.Event | None = None) -> None:
        self.abort = abort if abort is not None else threading.Event()
        self._lock = threading.Lock()
        self._stop = self._estop = self._confirmed = False
        self._pause: When | None = None
        self._interlocks: dict[str, float] = {}

    def pause(self, when: When) -> None:
        """Come to rest; a pause at once outweighs one at a safe point."""
        with self._lock:
            self._pause = When.NOW if When.NOW in (when, self._pause) else when

    def resume(self) -> None:
        """Go on where the run was paused, or take back a pause that has not begun."""
        with self._lock:
            self._pause = None

    def stop(self) -> None:
        """Gate closed, axes decelerated, no way back."""
        self._stop = True

    def estop(self) -> None:
        """Gate closed, motion ended at once, motors off, latched."""
        self._estop = True

    def confirm(self) -> None:
        """Say that what the run waits for by hand is done."""
        self._confirmed = True

    def interlock(self, name: str, value: float) -> None:
        """Push the value of an interlock that has no input of the controller."""
        with self._lock:
            self._interlocks[name] = value

    @property
    def pause_wanted(self) -> When | None:
        """The pause that is wanted, if any."""
        return self._pause

    @property
    def stop_wanted(self) -> bool:
        """Whether the run is to be stopped."""
        return self._stop

    @property
    def estop_wanted(self) -> bool:
        """Whether the run is to be stopped for good."""
        return self._estop

    @property
    def confirmed(self) -> bool:
        """Whether `confirm` was called."""
        return self._confirmed

    @property
    def interlocks(self) -> dict[str, float]:
        """Values pushed last, by name."""
        with self._lock:
            return dict(self._interlocks)
