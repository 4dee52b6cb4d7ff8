"""What an operator or an interlock wants of a run, set from any thread and looked at by the run."""

from __future__ import annotations

import threading
import time
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
        self._held: frozenset[str] = frozenset()
        self._pushed: dict[str, tuple[float, float]] = {}

    def pause(self, when: When) -> None:
        """Come to rest; a pause at once outweighs one at a safe point."""
        with self._lock:
            self._pause = When.NOW if When.NOW in (when, self._pause) else when

    def resume(self) -> None:
        """Go on where the run was paused, or take back a pause that has not begun.

        An interlock that is still out of its band holds the run all the same.
        """
        with self._lock:
            self._pause, self._held = None, frozenset()

    def stop(self) -> None:
        """Gate closed, axes decelerated, no way back."""
        self._stop = True

    def estop(self) -> None:
        """Gate closed, motion ended at once, motors off, latched."""
        self._estop = True

    def confirm(self) -> None:
        """Say that what the run waits for by hand is done."""
        self._confirmed = True

    def forget_confirmation(self) -> None:
        """Wait for a new one: what was confirmed before was something else."""
        self._confirmed = False

    def interlock(self, name: str, value: float) -> None:
        """Push the value of an interlock that has no input of the controller."""
        with self._lock:
            self._pushed[name] = value, time.monotonic()

    def hold(self, name: str) -> None:
        """Pause at once because of an interlock."""
        with self._lock:
            self._held |= {name}

    def release(self, name: str) -> None:
        """Take an interlock's pause back; an operator's stays."""
        with self._lock:
            self._held -= {name}

    @property
    def pause_wanted(self) -> When | None:
        """The pause that is wanted, if any."""
        return When.NOW if self._held else self._pause

    @property
    def held(self) -> frozenset[str]:
        """Names of the interlocks that hold the run."""
        return self._held

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
    def pushed(self) -> dict[str, tuple[float, float]]:
        """Value pushed last and when (monotonic clock), by name of the interlock."""
        with self._lock:
            return dict(self._pushed)
