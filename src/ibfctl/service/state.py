"""What all routers of one service share."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Coroutine
from typing import Annotated, Any, cast

from fastapi import Depends, Request

from ibfctl.service.children import Child
from ibfctl.service.settings import Settings
from ibfctl.service.store import Collection

_ENDED_BY_RESTART = {
    "code": "interrupted",
    "detail": "the service ended before this was done",
    "hint": "start it again",
}


class State:
    """The store, the work under way, and the settings of one service."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.maps = Collection(settings.data, "maps")
        self.influences = Collection(settings.data, "influences")
        self.plans = Collection(settings.data, "plans")
        self.runs = Collection(settings.data, "runs")
        self.starting_run = asyncio.Lock()
        self.planners = asyncio.Semaphore(len(os.sched_getaffinity(0)))
        self.progress: dict[str, dict[str, Any]] = {}
        self.running: dict[str, Child] = {}
        self._work: set[asyncio.Task[None]] = set()
        for collection in (self.plans, self.runs):
            for record in collection.records():
                if record["state"] in ("queued", "running"):
                    collection.update(record["id"], state="failed", error=_ENDED_BY_RESTART)

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


def _state(request: Request) -> State:
    return cast(State, request.app.state.service)


Service = Annotated[State, Depends(_state)]
