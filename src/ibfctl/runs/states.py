"""The states of a run and the one table of what may follow what."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from ibfctl.errors import RunError


class RunState(StrEnum):
    """Where a run is.

    `STOPPED`, `ABORTED` and `ESTOPPED` are three different ends: decelerated, at once, latched. `INTERRUPTED` says
    that no worker lives any more and that nobody saw the end. In `TOOL_CHANGE` the run waits for the next of its tools
    and for a confirmation; the gate is closed, nothing moves, and the machine is free to be homed.
    """

    QUEUED = "queued"
    PREFLIGHT = "preflight"
    MOVING_TO_START = "moving_to_start"
    ARMED = "armed"
    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"
    RESUMING = "resuming"
    FINISHING = "finishing"
    TOOL_CHANGE = "tool_change"
    COMPLETED = "completed"
    STOPPED = "stopped"
    ABORTED = "aborted"
    FAULTED = "faulted"
    INTERRUPTED = "interrupted"
    ESTOPPED = "estopped"


_S = RunState
_ENDS = frozenset({_S.STOPPED, _S.ABORTED, _S.FAULTED, _S.INTERRUPTED, _S.ESTOPPED})

TRANSITIONS: Mapping[RunState, frozenset[RunState]] = {
    _S.QUEUED: _ENDS | {_S.PREFLIGHT},
    # What the preflight of a later tool refuses can be put right: the run waits on.
    _S.PREFLIGHT: _ENDS | {_S.MOVING_TO_START, _S.TOOL_CHANGE},
    _S.MOVING_TO_START: _ENDS | {_S.ARMED},
    _S.ARMED: _ENDS | {_S.RUNNING},
    # A pause that comes too late for a seam before the end lets the run finish.
    _S.RUNNING: _ENDS | {_S.PAUSING, _S.FINISHING},
    _S.PAUSING: _ENDS | {_S.PAUSED, _S.FINISHING},
    _S.PAUSED: _ENDS | {_S.RESUMING},
    _S.RESUMING: _ENDS | {_S.RUNNING, _S.PAUSING, _S.TOOL_CHANGE},
    _S.FINISHING: _ENDS | {_S.COMPLETED, _S.TOOL_CHANGE},
    _S.TOOL_CHANGE: _ENDS | {_S.PREFLIGHT},
    _S.INTERRUPTED: frozenset({_S.RESUMING}),
    _S.COMPLETED: frozenset(),
    _S.STOPPED: frozenset(),
    _S.ABORTED: frozenset(),
    _S.FAULTED: frozenset(),
    _S.ESTOPPED: frozenset(),
}
"""For every state those that may follow it."""

TERMINAL = frozenset(state for state, following in TRANSITIONS.items() if not following)
"""Nothing follows these."""


def check(old: RunState, new: RunState) -> None:
    """Refuse a transition that the table does not hold.

    Raises
    ------
    RunError
        If `new` may not follow `old`.
    """
    if new not in TRANSITIONS[old]:
        allowed = ", ".join(sorted(TRANSITIONS[old])) or "nothing"
        raise RunError(f"a run that is {old} cannot become {new}", f"what may follow: {allowed}")
