"""The service itself: what it is, whether it answers and is ready, its figures, its description."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

from fastapi import APIRouter
from fastapi.responses import FileResponse, PlainTextResponse

from ibfctl import __version__
from ibfctl.service import metrics
from ibfctl.service.metrics import Metric
from ibfctl.service.models import Health, Info
from ibfctl.service.problems import ServiceError
from ibfctl.service.requests import refusals
from ibfctl.service.state import Service

router = APIRouter(prefix="/info", tags=["info"])
health = APIRouter(tags=["info"])
_NEEDED_DISK_BYTES = 100 << 20
_PAGE = Path(__file__).parents[1] / "web" / "docs.html"
_TEXT: dict[str, Any] = {"content": {"text/plain": {"schema": {"type": "string"}}}}
_HTML: dict[str, Any] = {"content": {"text/html": {"schema": {"type": "string"}}}}


@router.get("", responses=refusals())
async def show_info(service: Service) -> Info:
    """Show version, machine, and which runs are under way."""
    return Info(
        version=__version__,
        machine=service.machine.name,
        simulated=service.settings.simulate,
        running=service.fleet.living,
    )


@health.get("/healthz")
async def answers() -> Health:
    """Answer, to show that the service does."""
    return Health(status="ok")


@health.get("/readyz", responses=refusals(503, also=()))
async def is_ready(service: Service) -> Health:
    """Answer whether the service can take on work: its data folder can be written and has room."""
    data = service.settings.data
    if not os.access(data, os.W_OK | os.X_OK):
        raise ServiceError(503, "the data folder cannot be written", "correct its permissions", "not_ready")
    free = shutil.disk_usage(data).free
    if free < _NEEDED_DISK_BYTES:
        raise ServiceError(503, f"the data folder has {free >> 20} MiB left", "make room", "not_ready")
    return Health(status="ok")


@health.get("/metrics", response_class=PlainTextResponse, responses={200: _TEXT, **refusals(also=(401, 403))})
async def show_metrics(service: Service) -> PlainTextResponse:
    """Show figures of the service in Prometheus' text format."""
    info = Metric("ibfctl_info", "gauge", "The version that runs.", [({"version": __version__}, 1.0)])
    shown = [info, *service.requests.metrics(), *service.metrics()]
    return PlainTextResponse("".join(metric.text() for metric in shown), media_type=metrics.MEDIA_TYPE)


@health.get("/docs", response_class=FileResponse, responses={200: _HTML})
async def show_docs() -> FileResponse:
    """Show a page that describes every operation; nothing on it comes from elsewhere."""
    return FileResponse(_PAGE, media_type="text/html")
