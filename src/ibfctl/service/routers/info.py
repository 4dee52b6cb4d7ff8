"""The service itself: what it is, and whether it answers."""

from __future__ import annotations

from fastapi import APIRouter

from ibfctl import __version__
from ibfctl.machine.description import read_machine
from ibfctl.service.models import Info
from ibfctl.service.requests import refusals
from ibfctl.service.state import Service

router = APIRouter(prefix="/info", tags=["info"])
health = APIRouter(tags=["info"])


@router.get("", responses=refusals())
async def show_info(service: Service) -> Info:
    """Show version, machine, and which runs are under way."""
    return Info(
        version=__version__,
        machine=read_machine(service.settings.machine).name,
        simulated=service.settings.simulate,
        running=list(service.running),
    )


@health.get("/healthz", responses=refusals())
async def answers() -> dict[str, str]:
    """Answer, to show that the service does."""
    return {"status": "ok"}
