"""Plans: solved in a process of their own; 202 at once, then progress, then the summary."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field, model_validator

from ibfctl.service.children import TASKS, Child
from ibfctl.service.problems import ServiceError, problem
from ibfctl.service.state import Service, State

router = APIRouter(prefix="/plans", tags=["plans"])

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class PlanRequest(BaseModel):
    """What to plan; options as those of `ibfctl plan`."""

    model_config = ConfigDict(extra="forbid")

    map_id: str
    influence_id: str
    path: Literal["raster", "maze"] = "raster"
    seed: int = 0
    pitch_mm: Positive = 0.5
    step_mm: Positive = 0.5
    scan_axis: Literal["x", "y"] = "x"
    clear_aperture_mm: Annotated[
        tuple[Finite, Finite, Finite, Finite] | None,
        Field(description="x0, x1, y0, y1; default: the whole map."),
    ] = None
    remove: Literal["none", "piston", "tilt"] = "tilt"
    dwell_min_s: Positive | None = None
    corridor_mm: Positive | None = None
    loop: Annotated[bool, Field(description="Correct dwell times for the motion executed.")] = True
    max_time_s: Annotated[Positive | None, Field(description="The best residual within this run time.")] = (
        None
    )
    max_residual_nm: Annotated[
        Positive | None, Field(description="The shortest run to this residual, RMS.")
    ] = None

    @model_validator(mode="after")
    def _one_aim(self) -> Self:
        if self.max_time_s is not None and self.max_residual_nm is not None:
            raise ValueError("max_time_s and max_residual_nm exclude each other")
        return self


@router.post("", status_code=202)
async def start_plan(request: PlanRequest, response: Response, service: Service) -> dict[str, Any]:
    """Start planning for the machine of the service; `Location` is where progress and result appear."""
    surface, influence = service.maps.read(request.map_id), service.influences.read(request.influence_id)
    aim = {"max_time_s", "max_residual_nm"}
    options = request.model_dump(exclude={"map_id", "influence_id", "clear_aperture_mm", *aim})
    identity = service.plans.create()
    tool = influence.get("formula") or str(
        service.influences.path(influence["id"], f"upload.{influence['format']}")
    )
    arguments = {
        "map": {
            "path": str(service.maps.path(surface["id"], f"upload.{surface['format']}")),
            **surface["given"],
        },
        "influence": {"spec": tool, **influence["given"]},
        "machine": str(service.settings.machine),
        "options": {
            **options,
            "clear_aperture": request.clear_aperture_mm,
            "aim": request.model_dump(include=aim),
        },
        "output": str(service.plans.path(identity, "plan.h5")),
    }
    record = service.plans.write(identity, {"state": "queued", "request": request.model_dump()})
    service.start(_solve(service, identity, arguments))
    response.headers["Location"] = f"/v1/plans/{identity}"
    return record


@router.get("")
async def list_plans(service: Service) -> list[dict[str, Any]]:
    """List all plans, oldest first."""
    return service.plans.records()


@router.get("/{identity}")
async def show_plan(identity: str, service: Service) -> dict[str, Any]:
    """Show a plan: its state, its progress while it is solved, then the summary or what failed."""
    record = service.plans.read(identity)
    return record | {"progress": service.progress[identity]} if identity in service.progress else record


@router.get("/{identity}/plan.h5", response_class=FileResponse)
async def get_plan_file(identity: str, service: Service) -> FileResponse:
    """Download the plan file."""
    if service.plans.read(identity)["state"] != "done":
        raise ServiceError(409, f"plans/{identity}: is not done", "wait until its state is done")
    return FileResponse(service.plans.path(identity, "plan.h5"), filename="plan.h5")


async def _solve(service: State, identity: str, arguments: dict[str, Any]) -> None:
    async with service.planners:
        service.plans.update(identity, state="running")
        child = await Child.start(TASKS, ["plan"], arguments)

        def note(event: dict[str, Any]) -> None:
            service.progress[identity] = {"stage": event["stage"], "fraction": event["fraction"]}

        try:
            event = await child.last_event(note)
        finally:
            service.progress.pop(identity, None)
    if event["event"] == "failed":
        error = problem(422, event["code"], event["message"], event["hint"])
        service.plans.update(identity, state="failed", error=error)
    else:
        service.plans.update(identity, state="done", summary=event["figures"])
