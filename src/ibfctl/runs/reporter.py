"""Where all that a run tells goes: states are checked, everything is recorded, the status is shown."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import Any

from ibfctl.runs.recorder import JournalWriter
from ibfctl.runs.states import TERMINAL, RunState, check
from ibfctl.runs.status import StatusWriter

PROGRESS_S = 1.0
PATIENCE_S = 0.5


class RunReporter:
    """Takes what a run reports, from any thread; it waits for nothing but the record of what is about to move.

    Parameters
    ----------
    journal, status
        Where it goes.
    state
        The state that the run is in.

    Attributes
    ----------
    state
        The last state that was reported.
    """

    def __init__(self, journal: JournalWriter, status: StatusWriter, state: RunState) -> None:
        self._journal = journal
        self._status = status
        self._lock = threading.Lock()
        self._recorded_at = -float("inf")
        self._places: list[tuple[int, float, float]] = []
        self.state = state

    def __call__(self, kind: str, data: Mapping[str, Any], key: str | None = None) -> None:
        """Take one report.

        Parameters
        ----------
        kind
            ``state`` (with ``state``, and ``reason``, ``hint``, ``gate`` where there are any), ``progress`` (fields
            of the status; recorded once a second, with all places of the tool since), ``act``, ``fault``,
            ``interlock``, ``tool`` (what follows is of this one of several), or ``leg``: before it begins, with
            ``first_plan_sample`` and ``open_at``, and when it is over, with ``end``, ``open_plan_samples`` and
            ``uncertainty_samples`` as well.
        data
            What happened.
        key
            Id of the key of whoever caused it.

        Raises
        ------
        RunError
            If a state may not follow the last one.
        """
        if kind == "state":
            self._take_state(data, key)
        elif kind == "progress":
            self._take_progress(data)
        else:
            if kind == "leg" and self._places:
                self._record_places({})
            self._journal.record(kind, data, key)
        if data.get("state") == RunState.ARMED or (kind == "leg" and "end" not in data):
            # Recovery must know which motion the controller's stamps are of. The gate is closed and the axes stand,
            # so waiting does no harm; a journal that fails holds the run up no longer than this.
            self._journal.flush(PATIENCE_S)

    def _take_progress(self, data: Mapping[str, Any]) -> None:
        self._status.tell(**data, journal_ok=self._journal.ok)
        place = data.get("place")
        if place and data.get("gate") == "open":
            self._places.append((place["plan_sample"], place["x_mm"], place["y_mm"]))
        now = time.monotonic()
        if now >= self._recorded_at + PROGRESS_S:
            self._recorded_at = now
            self._record_places(data)

    def _record_places(self, data: Mapping[str, Any]) -> None:
        places, self._places = self._places, []
        self._journal.record("progress", {**data, "places": places})

    def _take_state(self, data: Mapping[str, Any], key: str | None) -> None:
        with self._lock:
            new = RunState(data["state"])
            check(self.state, new)
            self.state = new
            self._journal.record("state", data, key)
        gate = {"gate": data["gate"]} if "gate" in data else {}
        self._status.tell(state=new, **gate, **{name: data.get(name) for name in ("code", "reason", "hint")})

    @property
    def at_rest(self) -> bool:
        """Whether the run is over or interrupted."""
        return self.state in TERMINAL | {RunState.INTERRUPTED}
