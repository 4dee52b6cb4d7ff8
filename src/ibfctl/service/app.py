"""The application: routers, problems, and the lifetime of the work under way."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import Depends, FastAPI

from ibfctl import __version__
from ibfctl.service import problems
from ibfctl.service.access import Access
from ibfctl.service.audit import Audited
from ibfctl.service.conditional import Conditional
from ibfctl.service.description import describe
from ibfctl.service.keys import KeyRing
from ibfctl.service.metrics import Measured, Requests
from ibfctl.service.requests import refuse_unknown_query
from ibfctl.service.routers import events, influences, info, machine, machines, maps, plan_files, plans, runs
from ibfctl.service.settings import Settings
from ibfctl.service.state import State


def create_app(settings: Settings) -> FastAPI:
    """Make the application of one service.

    It does no numerics and moves no stage: both happen in processes of their own, so that it answers at once.
    FastAPI's own pages fetch from a content network; the one under /docs is the service's own.
    """
    measured = Requests()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with State.opened(settings, measured) as app.state.service:
            yield

    app = FastAPI(
        title="ibfctl",
        version=__version__,
        summary="Plan and run deterministic finishing on Galil motion controllers.",
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        dependencies=[Depends(refuse_unknown_query)],
    )
    problems.install(app)
    app.add_middleware(Conditional)
    app.add_middleware(Audited)
    app.add_middleware(Access, keys=KeyRing(settings.data))
    app.add_middleware(Measured, requests=measured)
    for module in (maps, influences, machines, plans, plan_files, runs, machine, events, info):
        app.include_router(module.router, prefix="/v1")
    app.include_router(machine.everything, prefix="/v1")
    app.include_router(info.health)
    describe(app)
    return app
