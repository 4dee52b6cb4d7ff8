"""Runs: a plan streamed to the controller by a worker process of its own; one at a time."""

from __future__ import annotations

from typing import Any, Literal, get_args

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict

from ibfctl.service.children import RUN_WORKER, TASKS, Child
from ibfctl.service.models import Page, RunRecord
from ibfctl.service.problems import ServiceError, problem
from ibfctl.service.requests import After, IdempotencyKey, Identity, Limit, file_on_demand, linked, page, refusals
from ibfctl.service.state import ENDED_WITH_SERVICE, Service, State
from ibfctl.service.store import Record, fingerprint_of

router = APIRouter(prefix="/runs", tags=["runs"])

RunFile = Literal["run.h5", "residual.npz", "residuals.png"]
_FILES: tuple[RunFile, ...] = get_args(RunFile)


class RunRequest(BaseModel):
    """What to run."""

    model_config = ConfigDict(extra="forbid")

    plan_id: str


@router.post(
    "", status_code=202, response_model=RunRecord, response_model_exclude_none=True, responses=refusals(404, 409)
)
async def start_run(request: RunRequest, response: Response, service: Service, key: IdempotencyKey = None) -> Record:
    """Stream a plan to the controller of the machine file, or to an emulated one."""
    fingerprint = fingerprint_of(request.model_dump())
    async with service.starting_run:
        record = service.runs.recall(key, fingerprint)
        if record is None:
            record = await _start(request.plan_id, service)
            service.runs.remember(key, fingerprint, record["id"])
    response.headers["Location"] = f"/v1/runs/{record['id']}"
    return _shown(service, record)


@router.get("", response_model=Page[RunRecord], response_model_exclude_none=True, responses=refusals())
async def list_runs(service: Service, limit: Limit = 100, after: After = None) -> dict[str, Any]:
    """List runs."""
    return page(service.runs, limit, after, lambda record: _shown(service, record))


@router.get("/{identity}", response_model=RunRecord, response_model_exclude_none=True, responses=refusals(404))
async def show_run(identity: Identity, service: Service) -> Record:
    """Show a run: progress with the buffer margin in seconds while it moves, then its figures or what failed."""
    return _shown(service, service.runs.read(identity))


@router.post(
    "/{identity}/abort",
    status_code=202,
    response_model=RunRecord,
    response_model_exclude_none=True,
    responses=refusals(404),
)
async def abort_run(identity: Identity, service: Service) -> Record:
    """Close the beam gate and stop all motion at once; a run that is over stays as it is."""
    if identity in service.running:
        await service.running[identity].tell("abort")
    return _shown(service, service.runs.read(identity))


@router.get("/{identity}/files/{name}", response_class=FileResponse, responses=refusals(404, 409))
async def get_run_file(identity: Identity, name: RunFile, service: Service) -> FileResponse:
    """Download a file of a simulated run."""
    record = service.runs.read(identity)
    if record["state"] != "done" or not record["simulated"]:
        raise ServiceError(409, f"runs/{identity}: has no files", "only a simulated run that is done has them")
    arguments = {
        "plan": str(service.plans.path(record["plan_id"], "plan.h5")),
        "run": str(service.runs.path(identity, "run.h5")),
    }
    return await file_on_demand(service.runs, identity, name, "run-files", arguments)


@router.delete("/{identity}", status_code=204, responses=refusals(404, 409, 412))
async def delete_run(identity: Identity, service: Service) -> None:
    """Delete a run that is over."""
    service.runs.read(identity)
    if identity in service.running:
        raise ServiceError(409, f"runs/{identity}: is under way", "wait for its end or abort it")
    service.runs.delete(identity)


def _shown(service: State, record: Record) -> Record:
    shown = linked(service.runs, record, _FILES if record["state"] == "done" and record["simulated"] else ())
    return {**shown, "progress": service.progress.get(record["id"])}


async def _start(plan_id: str, service: State) -> Record:
    if service.plans.read(plan_id)["state"] != "done":
        raise ServiceError(409, f"plans/{plan_id}: is not done", "wait until its state is done")
    if service.running:
        raise ServiceError(409, f"runs/{', '.join(service.running)}: is under way", "wait for its end or abort it")
    identity = service.runs.create()
    record = service.runs.write(
        identity, {"state": "running", "plan_id": plan_id, "simulated": service.settings.simulate}
    )
    job: dict[str, Any] = {"plan": str(service.plans.path(plan_id, "plan.h5"))}
    if service.settings.simulate:
        job |= {"trace": str(service.runs.path(identity, "trace.h5")), "speed": service.settings.speed}
    service.running[identity] = await Child.start(RUN_WORKER, [], job)
    service.start(_stream(service, identity, job))
    return record


async def _stream(service: State, identity: str, job: dict[str, Any]) -> None:
    def note(event: dict[str, Any]) -> None:
        service.progress[identity] = {name: value for name, value in event.items() if name != "event"}

    try:
        event = await service.running[identity].last_event(note)
        if event["event"] == "finished":
            outcome = {name: value for name, value in event.items() if name != "event"}
            event = await _record(service, identity, job, outcome)
    except BaseException:
        service.runs.update(identity, state="aborted", error=ENDED_WITH_SERVICE)
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


async def _record(service: State, identity: str, job: dict[str, Any], outcome: dict[str, Any]) -> dict[str, Any]:
    """Return the event of the task that finds what was removed; a real controller leaves no trace to it."""
    if "trace" not in job:
        return {"event": "finished", "figures": outcome}
    output = str(service.runs.path(identity, "run.h5"))
    arguments = {"plan": job["plan"], "outcome": outcome, "trace": job["trace"], "output": output}
    child = await Child.start(TASKS, ["record-run"], arguments)
    return await child.last_event(lambda progress: None)
