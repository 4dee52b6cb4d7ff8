"""Plan files that were made elsewhere: for the rest of a run, or on a planner's own computer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Query, Request

from ibfctl.jobs.plan_artefacts import PLAN
from ibfctl.service.bodies import BODY
from ibfctl.service.models import PlanRecord
from ibfctl.service.requests import IdempotencyKey, refusals
from ibfctl.service.routers.plans import machine_of, shown
from ibfctl.service.state import Service
from ibfctl.service.store import Record
from ibfctl.service.uploads import inspect, store_body

router = APIRouter(prefix="/plan-files", tags=["plans"])
MachineId = Annotated[
    str | None, Query(min_length=1, description="Machine that runs it; default: the service's own.")
]


@router.post(
    "",
    status_code=201,
    response_model=PlanRecord,
    response_model_exclude_none=True,
    responses=refusals(404, 409, 413),
    openapi_extra=BODY,
)
async def add_plan(
    request: Request, service: Service, machine_id: MachineId = None, key: IdempotencyKey = None
) -> Record:
    """Upload a plan file, e.g. that of `ibfctl replan` for the rest of a run; it is a plan that is done.

    The preflight of its run holds it against the machine, as that of any other.
    """
    machine_of(service, machine_id)

    async def of(path: Path, size: int, sha256: str) -> Record:
        asked = {"path": str(path), "max_pixels": service.settings.max_map_pixels}
        found = await inspect(service.plans, "inspect-plan", asked, path.name)
        tools = [{"machine_id": None}] * found["tools"] if found["tools"] > 1 else None
        given = {"machine_id": machine_id, "tools": tools, "bytes": size, "sha256": sha256}
        return {"state": "done", "request": given, "summary": found["summary"]}

    return shown(service, await store_body(request, service.settings, service.plans, PLAN, machine_id, key, of))
