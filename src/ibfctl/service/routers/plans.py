"""Plans: solved in a process of their own; 202 at once, then progress, then the summary."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse

from ibfctl.jobs.plan_artefacts import artefact_names
from ibfctl.service.children import TASKS, Child
from ibfctl.service.models import Page, PlanRecord
from ibfctl.service.part import MaskedAperture
from ibfctl.service.plan_request import PlanRequest, ToolRequest
from ibfctl.service.problems import ServiceError, problem
from ibfctl.service.requests import (
    After,
    FileName,
    IdempotencyKey,
    Identity,
    Limit,
    file_on_demand,
    linked,
    page,
    refusals,
)
from ibfctl.service.routers.machines import MACHINE_FILE
from ibfctl.service.state import Service, State
from ibfctl.service.store import Record, fingerprint_of

router = APIRouter(prefix="/plans", tags=["plans"])

@router.post(
    "", status_code=202, response_model=PlanRecord, response_model_exclude_none=True, responses=refusals(404, 409)
)
async def start_plan(request: PlanRequest, response: Response, service: Service, key: IdempotencyKey = None) -> Record:
    """Start planning for the machine of the service; `Location` is where progress and result appear."""
    fingerprint = fingerprint_of(request.model_dump())
    record = service.plans.recall(key, fingerprint)
    if record is None:
        arguments = _arguments(request, service)
        identity = service.plans.create()
        arguments["output"] = str(service.plans.path(identity, "plan.h5"))
        record = service.plans.write(identity, {"state": "queued", "request": request.model_dump()})
        service.plans.remember(key, fingerprint, identity)
        service.start(_solve(service, identity, arguments))
    response.headers["Location"] = f"/v1/plans/{record['id']}"
    return shown(service, record)


@router.get("", response_model=Page[PlanRecord], response_model_exclude_none=True, responses=refusals())
async def list_plans(service: Service, limit: Limit = 100, after: After = None) -> dict[str, Any]:
    """List plans."""
    return page(service.plans, limit, after, lambda record: shown(service, record))


@router.get("/{identity}", response_model=PlanRecord, response_model_exclude_none=True, responses=refusals(404))
async def show_plan(identity: Identity, service: Service) -> Record:
    """Show a plan: its state, its progress while it is solved, then the summary or what failed."""
    return shown(service, service.plans.read(identity))


@router.post(
    "/{identity}/cancel",
    status_code=202,
    response_model=PlanRecord,
    response_model_exclude_none=True,
    responses=refusals(404),
)
async def cancel_plan(identity: Identity, service: Service) -> Record:
    """Cancel the planning; a plan that is over stays as it is."""
    record = service.plans.read(identity)
    if identity in service.solving:
        service.solving[identity].hang_up()
    return shown(service, record)


@router.get("/{identity}/files/{name}", response_class=FileResponse, responses=refusals(404, 409))
async def get_plan_file(identity: Identity, name: Annotated[str, FileName], service: Service) -> FileResponse:
    """Download a file of a plan: the plan itself, exports for Galil's tool, tables, pictures, of every tool."""
    record = service.plans.read(identity)
    if record["state"] != "done":
        raise ServiceError(409, f"plans/{identity}: is not done", "wait until its state is done")
    if name not in _files_of(record):
        raise ServiceError(404, f"plans/{identity}: has no file of this name", "its links name those that it has")
    plan = str(service.plans.path(identity, "plan.h5"))
    return await file_on_demand(service.plans, identity, name, "plan-files", {"plan": plan})


@router.delete("/{identity}", status_code=204, responses=refusals(404, 409, 412))
async def delete_plan(identity: Identity, service: Service) -> None:
    """Delete a plan that is over and that no run refers to."""
    if service.plans.read(identity)["state"] in ("queued", "running"):
        raise ServiceError(409, f"plans/{identity}: is being solved", "cancel it first")
    service.refuse_if_used("plans", identity, service.runs)
    service.plans.delete(identity)


def shown(service: State, record: Record) -> Record:
    """Return a plan as a client sees it: with its links, and how far it is."""
    links = linked(service.plans, record, _files_of(record) if record["state"] == "done" else ())
    return {**links, "progress": service.progress.get(record["id"])}


def _files_of(record: Record) -> tuple[str, ...]:
    return artefact_names(len(record["request"].get("tools") or [None]))


def _arguments(request: PlanRequest, service: State) -> dict[str, Any]:
    """Return the arguments of the task that solves a plan, without its output."""
    surface = service.maps.read(request.map_id)
    what = {"map_id", "influence_id", "tools", "method", "tool_change_s", "machine_id"}
    aim = {"margin", "max_time_s", "max_residual_nm", "seconds_per_nm"}
    options = request.model_dump(exclude={*what, *aim})
    aperture = options.pop("clear_aperture_mm")
    if isinstance(request.clear_aperture_mm, MaskedAperture):
        mask = service.maps.read(request.clear_aperture_mm.mask_id)
        aperture = {"mask": {"path": service.upload_of(service.maps, mask["id"]), **mask["given"]}}
    arguments = {
        "map": {"path": service.upload_of(service.maps, surface["id"]), **surface["given"]},
        "options": {
            **options,
            "clear_aperture": aperture,
            "aim": request.model_dump(include=aim, exclude_none=True),
        },
    }
    if request.tools is None:
        tool = {"influence": _influence(service, request.influence_id or "")}
        return {**arguments, **tool, "machine": str(machine_of(service, request.machine_id))}
    tools = [_tool(service, tool, request) for tool in request.tools]
    return {**arguments, "tools": tools, "method": request.method, "tool_change_s": request.tool_change_s}


def _influence(service: State, identity: str) -> dict[str, Any]:
    influence = service.influences.read(identity)
    return {
        "spec": influence.get("formula") or service.upload_of(service.influences, influence["id"]),
        **influence["given"],
    }


def _tool(service: State, tool: ToolRequest, request: PlanRequest) -> dict[str, Any]:
    return {
        **tool.model_dump(exclude={"influence_id", "machine_id"}),
        "influence": _influence(service, tool.influence_id),
        "machine": str(machine_of(service, tool.machine_id or request.machine_id)),
    }


def machine_of_plan(service: State, plan: Record) -> Path:
    """Return the path of the machine file that a plan is run with.

    Tools may have been planned with files of their own; the run has one, and its preflight holds every tool against it.

    Raises
    ------
    ServiceError
        If the files differ, and the plan names none for all.
    """
    request = plan["request"]
    tools = request.get("tools") or [request]
    machines = {machine_of(service, tool["machine_id"] or request["machine_id"]) for tool in tools}
    if len(machines) > 1 and request["machine_id"] is not None:
        return machine_of(service, request["machine_id"])
    if len(machines) > 1:
        raise ServiceError(
            409, f"plans/{plan['id']}: its tools have several machines", "plan with a `machine_id` for all: the run's"
        )
    return machines.pop()


def machine_of(service: State, identity: str | None) -> Path:
    """Return the path of a machine file; without an id that of the service's own machine."""
    if identity is None:
        return service.settings.machine
    return service.machines.path(service.machines.read(identity)["id"], MACHINE_FILE)


async def _solve(service: State, identity: str, arguments: dict[str, Any]) -> None:
    def note(event: dict[str, Any]) -> None:
        service.progress[identity] = {"stage": event["stage"], "fraction": event["fraction"]}

    async with service.planners:
        service.plans.update(identity, state="running")
        try:
            service.solving[identity] = await Child.start(TASKS, ["plan"], arguments)
            event = await service.solving[identity].last_event(note)
        finally:
            service.solving.pop(identity, None)
            service.progress.pop(identity, None)
    if event["event"] == "failed":
        error = problem(422, event["code"], event["message"], event["hint"])
        service.plans.update(identity, state="failed", error=error)
    else:
        service.plans.update(identity, state="done", summary=event["figures"])
