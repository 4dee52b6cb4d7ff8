"""What all routers of one service share."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Coroutine, Mapping
from contextlib import asynccontextmanager
from typing import Annotated, Any, Self, cast

from fastapi import Depends, Request

from ibfctl.machine.description import read_machine
from ibfctl.runs.detached_emulator import DetachedEmulator
from ibfctl.runs.journal import Journal
from ibfctl.runs.places import SIDE, journal_path
from ibfctl.runs.recorder import JournalWriter, absorb
from ibfctl.service.access import Holder
from ibfctl.service.children import Child
from ibfctl.service.events import Events
from ibfctl.service.fleet import Fleet
from ibfctl.service.machine_desk import MachineDesk
from ibfctl.service.metrics import Metric, Requests
from ibfctl.service.problems import ServiceError, problem
from ibfctl.service.settings import Settings
from ibfctl.service.store import Collection

ENDED_WITH_SERVICE = problem(503, "interrupted", "the service ended before this was done", "start it again")


class State:
    """The store, the work under way, and the settings of one service."""

    def __init__(self, settings: Settings, requests: Requests, journal: Journal) -> None:
        self.settings = settings
        self.requests = requests
        self.machine = read_machine(settings.machine)
        self.maps = Collection(settings.data, "maps")
        self.influences = Collection(settings.data, "influences")
        self.machines = Collection(settings.data, "machines")
        self.plans = Collection(settings.data, "plans")
        self.runs = Collection(settings.data, "runs")
        self.events = Events(journal)
        self.fleet = Fleet(settings.data, self.runs, journal, self.events, self.start)
        self.desk = MachineDesk(settings, self.fleet, self.start)
        self.emulator: DetachedEmulator | None = None
        self.starting_run = asyncio.Lock()
        self.planners = asyncio.Semaphore(len(os.sched_getaffinity(0)))
        self.progress: dict[str, dict[str, Any]] = {}
        self.solving: dict[str, Child] = {}
        self._writer = JournalWriter(journal_path(settings.data), None, settings.data / SIDE)
        self._work: set[asyncio.Task[None]] = set()

    @classmethod
    @asynccontextmanager
    async def opened(cls, settings: Settings, requests: Requests) -> AsyncIterator[Self]:
        """Open what is there already, runs under way included; on the way out end all work but theirs."""
        with Journal.open(journal_path(settings.data)) as journal:
            absorb(journal, settings.data / SIDE)
            state = cls(settings, requests, journal)
            try:
                await state._open()
                yield state
            finally:
                await state._close()

    async def _open(self) -> None:
        for identity in self.plans.ids():
            if self.plans.read(identity)["state"] in ("queued", "running"):
                self.plans.update(identity, state="failed", error=ENDED_WITH_SERVICE)
        if self.settings.simulate:
            start = DetachedEmulator.start_or_adopt
            self.emulator = await asyncio.to_thread(start, self.settings.data, speed=self.settings.speed)
            self.desk.emulated = self.emulator.controller
        await self.fleet.adopt()
        self.start(self.fleet.watch())

    async def _close(self) -> None:
        """Cancel plans; runs go on without the service, and so does the emulated controller that they need."""
        for task in self._work:
            task.cancel()
        await asyncio.gather(*self._work, return_exceptions=True)
        self.fleet.let_go()
        if self.emulator is not None and self.emulator.in_use:
            self.emulator.let_go()
        elif self.emulator is not None:
            await asyncio.to_thread(self.emulator.end)
        await asyncio.to_thread(self._writer.close)

    def start(self, work: Coroutine[Any, Any, None]) -> None:
        """Do work beside the requests; it is ended, in order, with the service."""
        task = asyncio.create_task(work)
        self._work.add(task)
        task.add_done_callback(self._work.discard)

    def record(self, kind: str, data: Mapping[str, Any], key: str | None) -> None:
        """Write what the service did to the journal; never waits."""
        self._writer.record(kind, data, key)

    def metrics(self) -> list[Metric]:
        """Return figures of the work under way."""
        living = {run: self.fleet.status(run) or {} for run in self.fleet.living}

        def of_runs(name: str) -> list[tuple[dict[str, str], float]]:
            return [({"run": run}, told[name]) for run, told in living.items() if told.get(name) is not None]

        return [
            Metric("ibfctl_plans_under_way", "gauge", "Plans being solved.", [({}, len(self.solving))]),
            Metric("ibfctl_runs_under_way", "gauge", "Runs whose workers live.", [({}, len(living))]),
            Metric("ibfctl_run_margin_seconds", "gauge", "Motion in the controller's buffer.", of_runs("margin_s")),
            Metric("ibfctl_run_progress", "gauge", "Share of the plan's time.", of_runs("progress")),
            Metric("ibfctl_event_listeners", "gauge", "Streams of events.", [({}, self.events.listeners)]),
        ]

    def upload_of(self, collection: Collection, identity: str) -> str:
        """Return the path of the file that was uploaded for a resource."""
        return str(collection.path(identity, f"upload.{collection.read(identity)['format']}"))

    def refuse_if_used(self, kind: str, identity: str, by: Collection) -> None:
        """Refuse to delete what a plan or a run refers to."""
        for user in by.ids():
            if _refers(by.read(user), identity):
                raise ServiceError(409, f"{kind}/{identity}: is used by {by.kind}/{user}", "delete that first")


def _refers(record: Any, identity: str) -> bool:
    """Return whether an id stands anywhere in a record."""
    if isinstance(record, Mapping):
        return any(_refers(value, identity) for value in record.values())
    return any(_refers(value, identity) for value in record) if isinstance(record, list) else record == identity


# Not `async`, these two would each take every request to a thread and back.
async def _state(request: Request) -> State:
    return cast(State, request.app.state.service)


async def _holder(request: Request) -> Holder:
    return Holder.of(request.scope)


Service = Annotated[State, Depends(_state)]
Asking = Annotated[Holder, Depends(_holder)]
