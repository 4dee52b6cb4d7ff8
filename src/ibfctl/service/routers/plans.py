"""Plans: solved in a process of their own; 202 at once, then progress, then the summary."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field, model_validator

from ibfctl.service.children import TASKS, Child
from ibfctl.service.models import Page, PlanRecord
from ibfctl.service.part import Aperture, MaskedAperture, Placing, Positive
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

PlanFile = Literal[
    "plan.h5",
    "plan.csv",
    "plan.pvt.csv",
    "plan.pvt.dmc",
    "plan.gcode",
    "dwell.npz",
    "residual.npz",
    "map.png",
    "dwell.png",
    "velocities.png",
    "psd.png",
]
_FILES: tuple[PlanFile, ...] = get_args(PlanFile)


_EXAMPLE: dict[str, Any] = {
    "map_id": "019ab2c4d5e6f708",
    "influence_id": "019ab2c4d5e6f709",
    "pitch_mm": 1.0,
    "max_residual_nm": 0.5,
}


class PlanRequest(BaseModel):
    """What to plan; options as those of `ibfctl plan`."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [_EXAMPLE]})

    map_id: str
    influence_id: str
    machine_id: Annotated[str | None, Field(description="Machine to plan for; default: the service's own.")] = None
    path: Literal["raster", "maze", "spiral", "random"] = "raster"
    inside_out: Annotated[bool, Field(description="A spiral starts in the middle.")] = False
    seed: Annotated[int, Field(ge=0)] = 0
    pitch_mm: Annotated[
        Positive | None, Field(description="Distance between lines; default: a quarter of the tool's full width.")
    ] = None
    step_mm: Annotated[Positive | None, Field(description="Between nodes on a line; default: the pitch.")] = None
    scan_axis: Literal["x", "y"] = "x"
    clear_aperture_mm: Annotated[
        Aperture | None,
        Field(description="x0, x1, y0, y1, or a circle, a polygon or a mask; default: the whole map."),
    ] = None
    remove: Annotated[
        str, Field(pattern=r"^(none|piston|tilt|power|legendre:[0-8]|zernike:([1-9]|[123]\d|4[0-5]))$")
    ] = "tilt"
    extra_removal_nm: Annotated[Positive | None, Field(description="Depth that every place must lose.")] = None
    placement: Annotated[
        Placing | None, Field(description="How the part stands on the machine; default: in its coordinates.")
    ] = None
    dwell_min_s: Positive | None = None
    v_min_mm_s: Annotated[
        Positive | None, Field(description="Slowest mean speed over a step: an upper bound of every dwell time.")
    ] = None
    dwell_bounds: Annotated[
        Literal["machine", "ramp"],
        Field(description="Shortest times of the machine, or also the bounds of linear ramps."),
    ] = "machine"
    corridor_mm: Positive | None = None
    corner_tolerance_mm: Annotated[
        Positive | None, Field(description="Round corners, leaving the programmed path by no more.")
    ] = None
    loop: Annotated[bool, Field(description="Correct dwell times for the motion executed.")] = True
    margin: Annotated[
        float | None, Field(ge=0, le=10, description="Share of the residual given for time; default: 0.01.")
    ] = None
    max_time_s: Annotated[Positive | None, Field(description="The best residual within this run time.")] = None
    max_residual_nm: Annotated[Positive | None, Field(description="The shortest run to this residual, RMS.")] = None

    tikhonov: Annotated[float, Field(ge=0, le=1, description="Relative to the largest eigenvalue.")] = 1e-8
    l_curve: Annotated[bool, Field(description="Find the Tikhonov factor by the L-curve.")] = False
    trade_off: Annotated[bool, Field(description="Add the curve of residual against time.")] = False

    @model_validator(mode="after")
    def _one_aim(self) -> Self:
        if sum(aim is not None for aim in (self.margin, self.max_time_s, self.max_residual_nm)) > 1:
            raise ValueError("margin, max_time_s and max_residual_nm exclude each other")
        return self


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
    return _shown(service, record)


@router.get("", response_model=Page[PlanRecord], response_model_exclude_none=True, responses=refusals())
async def list_plans(service: Service, limit: Limit = 100, after: After = None) -> dict[str, Any]:
    """List plans."""
    return page(service.plans, limit, after, lambda record: _shown(service, record))


@router.get("/{identity}", response_model=PlanRecord, response_model_exclude_none=True, responses=refusals(404))
async def show_plan(identity: Identity, service: Service) -> Record:
    """Show a plan: its state, its progress while it is solved, then the summary or what failed."""
    return _shown(service, service.plans.read(identity))


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
    return _shown(service, record)


@router.get("/{identity}/files/{name}", response_class=FileResponse, responses=refusals(404, 409))
async def get_plan_file(identity: Identity, name: Annotated[PlanFile, FileName], service: Service) -> FileResponse:
    """Download a file of a plan: the plan itself, exports for Galil's tool, tables, pictures."""
    if service.plans.read(identity)["state"] != "done":
        raise ServiceError(409, f"plans/{identity}: is not done", "wait until its state is done")
    plan = str(service.plans.path(identity, "plan.h5"))
    return await file_on_demand(service.plans, identity, name, "plan-files", {"plan": plan})


@router.delete("/{identity}", status_code=204, responses=refusals(404, 409, 412))
async def delete_plan(identity: Identity, service: Service) -> None:
    """Delete a plan that is over and that no run refers to."""
    if service.plans.read(identity)["state"] in ("queued", "running"):
        raise ServiceError(409, f"plans/{identity}: is being solved", "cancel it first")
    service.refuse_if_used("plans", identity, service.runs, "plan_id")
    service.plans.delete(identity)


def _shown(service: State, record: Record) -> Record:
    shown = linked(service.plans, record, _FILES if record["state"] == "done" else ())
    return {**shown, "progress": service.progress.get(record["id"])}


def _arguments(request: PlanRequest, service: State) -> dict[str, Any]:
    """Return the arguments of the task that solves a plan, without its output."""
    surface, influence = service.maps.read(request.map_id), service.influences.read(request.influence_id)
    aim = {"margin", "max_time_s", "max_residual_nm"}
    options = request.model_dump(exclude={"map_id", "influence_id", "machine_id", *aim})
    aperture = options.pop("clear_aperture_mm")
    if isinstance(request.clear_aperture_mm, MaskedAperture):
        mask = service.maps.read(request.clear_aperture_mm.mask_id)
        aperture = {"mask": {"path": service.upload_of(service.maps, mask["id"]), **mask["given"]}}
    tool = influence.get("formula") or service.upload_of(service.influences, influence["id"])
    return {
        "map": {"path": service.upload_of(service.maps, surface["id"]), **surface["given"]},
        "influence": {"spec": tool, **influence["given"]},
        "machine": str(machine_of(service, request.machine_id)),
        "options": {
            **options,
            "clear_aperture": aperture,
            "aim": request.model_dump(include=aim, exclude_none=True),
        },
    }


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
