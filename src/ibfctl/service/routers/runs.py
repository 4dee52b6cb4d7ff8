"""Runs: a plan streamed to the controller by a worker process of its own; one at a time."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict

from ibfctl.service.children import RUN_WORKER, TASKS, Child
from ibfctl.service.problems import ServiceError, problem
from ibfctl.service.state import Service, State

router = APIRouter(prefix="/runs", tags=["runs"])


class RunRequest(BaseModel):
    """What to run."""

    model_config = ConfigDict(extra="forbid")

    plan_id: str


@router.post("", status_code=202)
async def start_run(request: RunRequest, response: Response, service: Service) -> dict[str, Any]:
    """Stream a plan to the controller of the machine file, or to an emulated one."""
    plan = service.plans.read(request.plan_id)
    if plan["state"] != "done":
        raise ServiceError(409, f"plans/{request.plan_id}: is not done", "wait until its state is done")
    async with service.starting_run:
        return await _start(plan["id"], response, service)


async def _start(plan_id: str, response: Response, service: State) -> dict[str, Any]:
    if service.running:
        busy = ", ".join(service.running)
        raise ServiceError(409, f"runs/{busy}: is under way", "wait for its end or abort it")
    identity = service.runs.create()
    record = service.runs.write(
        identity,
        {"state": "running", "plan_id": plan_id, "simulated": service.settings.simulate},
    )
    job: dict[str, Any] = {"plan": str(service.plans.path(plan_id, "plan.h5"))}
    if service.settings.simulate:
        job |= {"trace": str(service.runs.path(identity, "trace.h5")), "speed": service.settings.speed}
    service.running[identity] = await Child.start(RUN_WORKER, [], job)
    service.start(_stream(service, identity, job))
    response.headers["Location"] = f"/v1/runs/{identity}"
    return record


@router.get("")
async def list_runs(service: Service) -> list[dict[str, Any]]:
    """List all runs, oldest first."""
    return service.runs.records()


@router.get("/{identity}")
async def show_run(identity: str, service: Service) -> dict[str, Any]:
    """Show a run: its progress with the buffer margin in seconds while it moves, then its figures or what failed."""
    record = service.runs.read(identity)
    return record | {"progress": service.progress[identity]} if identity in service.progress else record


@router.post("/{identity}/abort", status_code=202)
async def abort_run(identity: str, service: Service) -> dict[str, Any]:
    """Close the beam gate and stop all motion at once; a run that is over stays as it is."""
    record = service.runs.read(identity)
    if identity in service.running:
        await service.running[identity].tell("abort")
    return record


@router.get("/{identity}/run.h5", response_class=FileResponse)
async def get_run_file(identity: str, service: Service) -> FileResponse:
    """Download the run file."""
    path = service.runs.path(service.runs.read(identity)["id"], "run.h5")
    if not path.is_file():
        raise ServiceError(
            409, f"runs/{identity}: has no run file", "only a simulated run that is done has one"
        )
    return FileResponse(path, filename="run.h5")


async def _stream(service: State, identity: str, job: dict[str, Any]) -> None:
    def note(event: dict[str, Any]) -> None:
        service.progress[identity] = {name: value for name, value in event.items() if name != "event"}

    try:
        event = await service.running[identity].last_event(note)
        if event["event"] == "finished":
            outcome = {name: value for name, value in event.items() if name != "event"}
            event = await _record(service, identity, job, outcome)
    except BaseException:
        service.runs.update(identity, state="aborted")
        raise
    finally:
        del service.running[identity]
        service.progress.pop(identity, None)
    if event["event"] == "finished":
        service.runs.update(identity, state="done", figures=event["figures"])
        return
    state = "aborted" if event["code"] == "aborted" else "failed"
    error = problem(409, event["code"], event["message"], event["hint"])
    service.runs.update(identity, state=state, error=error)


async def _record(
    service: State, identity: str, job: dict[str, Any], outcome: dict[str, Any]
) -> dict[str, Any]:
    """Return the event of the task that finds what was removed; a real controller leaves no trace to it."""
    if "trace" not in job:
        return {"event": "finished", "figures": outcome}
    output = str(service.runs.path(identity, "run.h5"))
    arguments = {"plan": job["plan"], "outcome": outcome, "trace": job["trace"], "output": output}
    child = await Child.start(TASKS, ["record-run"], arguments)
    return await child.last_event(lambda progress: None)
