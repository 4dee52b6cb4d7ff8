"""The controller's counts must agree with each other and with what was sent."""

from __future__ import annotations

from ibfctl.errors import EstoppedError, RunError
from ibfctl.machine.controller import BufferStatus

STOPPED, RAN_DRY = 4, 32
EMERGENCY = (6, 11, 15)
"""Abort input, selective abort input, and amplifiers without power."""

LASTING_POLLS = 6
"""An answer names the axes one by one, so a segment may end in between, but not so many times in a row."""

HINTS = {
    2: "forward limit reached: check the limit switch and the part's position",
    3: "reverse limit reached: check the limit switch and the part's position",
    STOPPED: "something else sent ST to the controller: see who else is connected",
    6: "the abort input was triggered: check the interlock chain",
    7: "something else sent AB to the controller: see who else is connected",
    8: "position error limit exceeded: check the stage for obstruction and the servo tuning",
    11: "the selective abort input was triggered: check the interlock chain",
    12: "encoder failure: check encoder and cable",
    15: "amplifier fault: check the amplifier",
    RAN_DRY: "the buffer ran empty: ease the host's load or its network",
}


class CountCheck:
    """Checks every poll of a run.

    Parameters
    ----------
    places
        Places of one axis' buffer.
    running_code, complete_code
        Stop codes of a program that runs and of one that has ended as it should.
    """

    def __init__(self, places: int, running_code: int, complete_code: int) -> None:
        self._places = places
        self._running_code = running_code
        self._complete_code = complete_code
        self._lagging_polls = 0
        self._short_polls: dict[str, int] = {}
        self._executed: dict[str, int] = {}

    def __call__(self, status: BufferStatus, sent: int, end_sent: bool) -> None:
        """Raise `RunError` unless `status` is what `sent` segments (and an end marker) can lead to."""
        for letter, code in status.stop_codes.items():
            if code in EMERGENCY:
                raise EstoppedError(f"emergency stop: axis {letter} stopped with code {code}", HINTS[code])
        if not status.guard_runs:
            codes = ", ".join(f"{letter} {code}" for letter, code in status.stop_codes.items())
            telling = [HINTS[code] for code in status.stop_codes.values() if code in HINTS and code != STOPPED]
            raise RunError(
                f"the guard on the controller closed the gate and stopped the axes: {status.guard_reason} "
                f"(stop codes {codes})",
                telling[0] if telling else "ease the host's load or its network, and see who else is connected",
            )
        self._check_stop_codes(status, end_sent)
        self._check_lag(status)
        queued = sent + end_sent
        for letter, executed in status.executed_segments.items():
            waiting = self._places - status.free_places[letter]
            # One segment is in motion, and the two numbers were read one after the other.
            missing = queued - executed - waiting
            self._short_polls[letter] = self._short_polls.get(letter, 0) + 1 if missing > 1 else 0
            accounted = 0 <= missing <= 2 and self._short_polls[letter] <= LASTING_POLLS
            if not accounted or not self._executed.get(letter, 0) <= executed <= queued:
                raise RunError(
                    f"axis {letter}: {queued} segments sent, but {executed} executed and {waiting} waiting",
                    "segments were lost or made up: check that nobody else sends motion to this controller",
                )
        self._executed = dict(status.executed_segments)

    def _check_stop_codes(self, status: BufferStatus, end_sent: bool) -> None:
        for letter, code in status.stop_codes.items():
            if code != self._running_code and not (end_sent and code == self._complete_code):
                executed = status.executed_segments[letter]
                raise RunError(
                    f"axis {letter} stopped with code {code} after {executed} segments",
                    HINTS.get(code, "look the stop code (SC) up in the controller's command reference"),
                )

    def _check_lag(self, status: BufferStatus) -> None:
        executed = status.executed_segments
        lag = max(executed.values()) - min(executed.values())
        self._lagging_polls = self._lagging_polls + 1 if lag else 0
        if lag > 1 or self._lagging_polls > LASTING_POLLS:
            counts = ", ".join(f"{letter} {count}" for letter, count in executed.items())
            raise RunError(
                f"axes no longer execute the same segment ({counts})",
                "the path is lost: measure the part before planning what is left",
            )
