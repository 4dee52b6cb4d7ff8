"""All runs of the service: it starts their workers, finds them again, passes acts on, and reads what they tell.

A run belongs to its worker process and to nobody here: the service may end and come back at any time.
"""

from __future__ import annotations

import asyncio
import logging
import sqlite3
import subprocess
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ibfctl.errors import IbfctlError, RunError
from ibfctl.machine.description import read_machine
from ibfctl.runs import status
from ibfctl.runs.adoption import REASON, end_orphan, has_worker, interrupt_orphans, last_state
from ibfctl.runs.control import URGENT, send
from ibfctl.runs.job import Job, prepare
from ibfctl.runs.journal import Event, Journal
from ibfctl.runs.launch import let_go, start_worker
from ibfctl.runs.places import MACHINE, RUN, run_folder
from ibfctl.runs.states import TERMINAL, RunState
from ibfctl.service.children import TASKS, Child
from ibfctl.service.events import UNSHOWN, Events
from ibfctl.service.problems import ServiceError, problem
from ibfctl.service.rescue import (
    HEARD_S,
    LAST_S,
    act_without,
    is_true_within,
    kill_worker,
    request_for_run,
)
from ibfctl.service.store import Collection, new_identity

TICK_S = 0.1
SETTLING_S = 10.0
AT_REST = TERMINAL | {RunState.INTERRUPTED}
"""States in which a run has no worker."""

Beside = Callable[[Coroutine[Any, Any, None]], None]

_log = logging.getLogger(__name__)


@dataclass
class _Living:
    """A run whose worker lives: its folder, its process if it is a child of this one, its newest status."""

    folder: Path
    process: subprocess.Popen[bytes] | None = None
    status: dict[str, Any] = field(default_factory=dict)
    closing: bool = False
    urged: set[str] = field(default_factory=set)


class Fleet:
    """The runs of one data folder.

    Parameters
    ----------
    data
        The folder.
    runs
        The records that clients see.
    journal, events
        What the workers have told, and where it goes.
    beside
        Does work beside the requests.
    """

    def __init__(self, data: Path, runs: Collection, journal: Journal, events: Events, beside: Beside) -> None:
        self._data = data
        self._runs = runs
        self._journal = journal
        self._events = events
        self._beside = beside
        self._living: dict[str, _Living] = {}

    @property
    def living(self) -> list[str]:
        """Ids of the runs whose workers live."""
        return list(self._living)

    def status(self, run: str) -> dict[str, Any] | None:
        """Return the newest status of a run whose worker lives."""
        found = self._living.get(run)
        return found.status or None if found else None

    def state(self, run: str) -> RunState:
        """Return the state of a run as it is known now; one that is over is finishing until its figures are there."""
        living = self._living.get(run)
        if living is None or not living.status:
            return RunState(self._runs.read(run)["state"])
        state = RunState(living.status["state"])
        if state is RunState.INTERRUPTED and not living.closing:
            return RunState.RESUMING  # that was the worker before
        return RunState.FINISHING if state is RunState.COMPLETED else state

    async def adopt(self) -> None:
        """Find the workers that live, and close the books of runs whose workers died unseen."""
        await asyncio.to_thread(interrupt_orphans, self._data)
        for run in self._runs.ids():
            if RunState(self._runs.read(run)["state"]) not in AT_REST:
                folder = run_folder(self._data, run)
                self._living[run] = _Living(folder, status=status.read(folder) or {})

    async def start(self, job: Job, plan: Path, machine: Path) -> None:
        """Start the worker of a new run."""
        folder = await asyncio.to_thread(prepare, self._data, job, plan, machine)
        self._living[job.run] = _Living(folder, await asyncio.to_thread(start_worker, folder))

    async def settled(self, patience_s: float = SETTLING_S) -> None:
        """Wait for the workers of runs that are over to end: they still write, and may hold the machine."""
        for _ in range(round(patience_s / TICK_S)):
            if not any(RunState(told["state"]) in AT_REST for run in self.living if (told := self.status(run))):
                return
            await asyncio.sleep(TICK_S)

    async def resume(self, run: str) -> None:
        """Go on with an interrupted run, by a new worker.

        Raises
        ------
        ServiceError
            If it cannot be resumed, or the machine cannot be asked.
        """
        folder = run_folder(self._data, run)
        event = await _task("resume-run", {"folder": str(folder)})
        if event["event"] == "failed":
            raise ServiceError(409, event["message"], event["hint"], event["code"])
        self._runs.update(run, state=RunState.RESUMING, recovered=event["figures"])
        self._living[run] = _Living(folder)

    async def recover(self, run: str) -> None:
        """Find out what a run without a worker has executed, and note it.

        Raises
        ------
        ServiceError
            If the machine cannot be asked.
        """
        folder = run_folder(self._data, run)
        event = await _task("recover-run", {"folder": str(folder)})
        if event["event"] == "failed":
            raise ServiceError(409, event["message"], event["hint"], event["code"])
        told = {"recovered": event["figures"], "status": status.read(folder)}
        self._runs.update(run, **told, **await _figures(folder))

    def pushed_interlocks(self, run: str) -> list[str]:
        """Return the names of the interlocks of a run whose values are pushed."""
        machine = read_machine(run_folder(self._data, run) / MACHINE)
        return [interlock.name for interlock in machine.interlocks if interlock.kind == "pushed"]

    def act(self, run: str, act: Mapping[str, Any]) -> None:
        """Hand an act to the worker of a run; an abort and an emergency stop are seen to, whether it acts or not.

        Raises
        ------
        RunError
            If no worker lives.
        """
        living, name = self._living.get(run), act["act"]
        if living is not None and name in URGENT and name not in living.urged:
            living.urged.add(name)
            self._beside(self._see_to(run, living, name))
        send(run_folder(self._data, run), act)

    def let_go(self) -> None:
        """Leave all workers to themselves."""
        for living in self._living.values():
            if living.process is not None:
                let_go(living.process)

    async def watch(self) -> None:
        """Read what is new, ten times a second, until this is cancelled."""
        while True:
            try:
                events, told, gone = await asyncio.to_thread(self._read)
                self._events.add(events, told)
                for run in gone:
                    self._beside(self._close_books(run))
            except (sqlite3.Error, OSError, RunError):
                _log.exception("what the runs tell cannot be read")
            await asyncio.sleep(TICK_S)

    def _read(self) -> tuple[list[Event], list[Mapping[str, Any]], list[str]]:
        """Return new events, new statuses, and the runs that have lost their workers."""
        gone, told = [], list[Mapping[str, Any]]()
        for run, living in list(self._living.items()):
            if living.process is not None:
                living.process.poll()  # a child that has ended is to be waited for
            if not living.closing and not has_worker(living.folder):
                living.closing = True
                gone.append(run)
            now = status.read(living.folder)
            if now is not None and now["seq"] != living.status.get("seq"):
                living.status = now
                told.append(now)
        return self._journal.events(self._events.last_id, without=UNSHOWN), told, gone

    async def _see_to(self, run: str, living: _Living, act: str) -> None:
        """Reach the controller without a worker that does not act, and end it if it still does not."""

        def ended() -> bool:
            return living.closing or RunState(living.status.get("state", RunState.QUEUED)) in AT_REST

        if await is_true_within(ended, HEARD_S):
            return
        folder = living.folder
        request = request_for_run(act, folder)
        safe = False
        while not safe:  # a worker that cannot reach the controller either is left to go on trying
            safe, told = await act_without("the worker", act, self._data / "acts" / new_identity(), request)
            await asyncio.to_thread(self._journal.append, run, "fault", told)
            if await is_true_within(ended, LAST_S) or act != max(living.urged):  # an e-stop outweighs an abort
                return
        living.closing = True  # from here on its books are closed here
        try:
            kill_worker(folder)
        except IbfctlError as error:
            living.closing = False
            _log.error("%s", error)
            return
        await is_true_within(lambda: not has_worker(folder), HEARD_S)
        state = RunState.ESTOPPED if act == "estop" else RunState.ABORTED
        shown = {"code": told["code"], "reason": told["message"], "hint": told["hint"]}
        await asyncio.to_thread(end_orphan, folder, state, {**shown, "gate": "closed"})
        await self._close_books(run, abandoned=True)

    async def _close_books(self, run: str, *, abandoned: bool = False) -> None:
        """Note how a run has ended, with the figures that it has left; one that was abandoned has told nothing."""
        await asyncio.to_thread(interrupt_orphans, self._data)
        folder = run_folder(self._data, run)
        state = last_state(self._journal, run)
        if state is RunState.QUEUED:  # its worker has died before it could begin
            state = RunState.INTERRUPTED
            self._journal.append(run, "state", {"state": state, "reason": REASON})
        changes: dict[str, Any] = {"state": state}
        if abandoned or state is RunState.INTERRUPTED:  # whatever else: the gate must be closed
            event = await _task("recover-run", {"folder": str(folder)})
            changes["recovered"] = event.get("figures") or {"can_resume": False, "why_not": event["message"]}
        self._runs.update(run, **changes, status=status.read(folder), **await _figures(folder))
        process = self._living.pop(run).process
        self._events.forget(run)
        if process is not None:
            await asyncio.to_thread(process.wait)


async def _figures(folder: Path) -> dict[str, Any]:
    """Return the figures of the run in a folder as a field of its record, if it has left any."""
    if (folder / RUN).is_file():
        event = await _task("run-report", {"run": str(folder / RUN)})
        if event["event"] == "finished":
            return {"figures": event["figures"]}
    return {}


async def _task(name: str, arguments: dict[str, Any]) -> dict[str, Any]:
    child = await Child.start(TASKS, [name], arguments)
    return await child.last_event(lambda progress: None)


def error_of(state: RunState, told: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return why a run has ended otherwise than as planned, as its worker told; None if it has not."""
    if state not in AT_REST or state is RunState.COMPLETED:
        return None
    code, reason, hint = ((told or {}).get(name) for name in ("code", "reason", "hint"))
    return problem(409, code or str(state), reason or f"the run was {state}", hint or "")
