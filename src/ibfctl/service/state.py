"""What all routers of one service share."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Coroutine
from typing import Annotated, Any, cast

from fastapi import Depends, Request

from ibfctl.service.children import Child
from ibfctl.service.metrics import Metric, Requests
from ibfctl.service.problems import ServiceError, problem
from ibfctl.service.settings import Settings
from ibfctl.service.store import Collection

ENDED_WITH_SERVICE = problem(503, "interrupted", "the service ended before this was done", "start it again")


class State:
    """The store, the work under way, and the settings of one service."""

    def __init__(self, settings: Settings, requests: Requests) -> None:
        self.settings = settings
        self.maps = Collection(settings.data, "maps")
        self.influences = Collection(settings.data, "influences")
        self.machines = Collection(settings.data, "machines")
        self.plans = Collection(settings.data, "plans")
        self.runs = Collection(settings.data, "runs")
        self.requests = requests
        self.starting_run = asyncio.Lock()
        self.planners = asyncio.Semaphore(len(os.sched_getaffinity(0)))
        self.progress: dict[str, dict[str, Any]] = {}
        self.solving: dict[str, Child] = {}
        self.running: dict[str, Child] = {}
        self._work: set[asyncio.Task[None]] = set()
        for collection in (self.plans, self.runs):
            for identity in collection.ids():
                if collection.read(identity)["state"] in ("queued", "running"):
                    collection.update(identity, state="failed", error=ENDED_WITH_SERVICE)

    def start(self, work: Coroutine[Any, Any, None]) -> None:
        """Do work beside the requests; it is ended, in order, with the service."""
        task = asyncio.create_task(work)
        self._work.add(task)
        task.add_done_callback(self._work.discard)

    async def close(self) -> None:
        """End all work: plans are cancelled, a run is aborted."""
        for task in self._work:
            task.cancel()
        await asyncio.gather(*self._work, return_exceptions=True)

    def metrics(self) -> list[Metric]:
        """Return figures of the work under way."""
        return [
            Metric("ibfctl_plans_under_way", "gauge", "Plans queued or being solved.", [({}, len(self._work))]),
        ]

    def upload_of(self, collection: Collection, identity: str) -> str:
        """Return the path of the file that was uploaded for a resource."""
        return str(collection.path(identity, f"upload.{collection.read(identity)['format']}"))

    def refuse_if_used(self, kind: str, identity: str, by: Collection, reference: str) -> None:
        """Refuse to delete what a plan or a run refers to."""
        for user in by.ids():
            record = by.read(user)
            if identity in (record.get(reference), record.get("request", {}).get(reference)):
                raise ServiceError(409, f"{kind}/{identity}: is used by {by.kind}/{user}", "delete that first")


def _state(request: Request) -> State:
    return cast(State, request.app.state.service)


Service = Annotated[State, Depends(_state)]
