"""Runs: a plan streamed to its controller by a worker process of its own; acts are passed on to that."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field

from ibfctl.errors import RunError
from ibfctl.runs.job import Address, Job
from ibfctl.runs.states import TRANSITIONS, RunState
from ibfctl.service.access import Holder
from ibfctl.service.fleet import AT_REST, error_of
from ibfctl.service.models import Page, RunRecord
from ibfctl.service.part import Finite
from ibfctl.service.problems import ServiceError
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
from ibfctl.service.routers.plans import machine_of_plan
from ibfctl.service.state import Asking, Service, State
from ibfctl.service.store import Record, fingerprint_of

router = APIRouter(prefix="/runs", tags=["runs"])

_FILES = ("run.h5", "residual.npz", "residuals.png")
_Text = Annotated[str, Field(min_length=1, max_length=200)]
_MAY: dict[str, frozenset[RunState]] = {
    "pause": frozenset(state for state in RunState if RunState.PAUSING in TRANSITIONS[state]),
    "resume": frozenset(state for state in RunState if RunState.RESUMING in TRANSITIONS[state]),
    "confirm": frozenset({RunState.TOOL_CHANGE}),
}
"""In which states a run takes an act; all others it takes in every state."""


class RunRequest(BaseModel):
    """What to run."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"plan_id": "019ab2c4d5e6f708"}]})

    plan_id: str
    operator: Annotated[_Text | None, Field(description="Who starts it; default: the name of the key.")] = None


class PauseRequest(BaseModel):
    """When to pause."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"when": "now"}]})

    when: Annotated[
        Literal["safe-point", "now"],
        Field(description="At the next end of a segment, or with the gate closed at once."),
    ] = "safe-point"


class InterlockRequest(BaseModel):
    """A value for an interlock of the machine file."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"name": "beam_current", "value": 1.2}]})

    name: Annotated[_Text, Field(description="Name in the machine file.")]
    value: Annotated[Finite, Field(description="In the unit of its band.")]


@router.post(
    "", status_code=202, response_model=RunRecord, response_model_exclude_none=True, responses=refusals(404, 409)
)
async def start_run(
    request: RunRequest, response: Response, service: Service, asking: Asking, key: IdempotencyKey = None
) -> Record:
    """Stream a plan to the controller of its machine, or to an emulated one; one run at a time on each machine."""
    fingerprint = fingerprint_of(request.model_dump())
    async with service.starting_run:
        record = service.runs.recall(key, fingerprint)
        if record is None:
            await service.fleet.settled()
            record = await _start(request, service, asking)
            service.runs.remember(key, fingerprint, record["id"])
    response.headers["Location"] = f"/v1/runs/{record['id']}"
    return _shown(service, record)


@router.get("", response_model=Page[RunRecord], response_model_exclude_none=True, responses=refusals())
async def list_runs(service: Service, limit: Limit = 100, after: After = None) -> dict[str, Any]:
    """List runs."""
    return page(service.runs, limit, after, lambda record: _shown(service, record))


@router.get("/{identity}", response_model=RunRecord, response_model_exclude_none=True, responses=refusals(404))
async def show_run(identity: Identity, service: Service) -> Record:
    """Show a run: its state and its newest status, then its figures or what ended it."""
    return _shown(service, service.runs.read(identity))


_ACT: dict[str, Any] = {
    "status_code": 202,
    "response_model": RunRecord,
    "response_model_exclude_none": True,
    "responses": refusals(404, 409),
}


@router.post("/{identity}/pause", **_ACT)
async def pause_run(
    identity: Identity, service: Service, asking: Asking, request: PauseRequest | None = None
) -> Record:
    """Pause: ramp to rest along the path with the gate closed."""
    when = (request or PauseRequest()).when
    return _pass_on(service, identity, asking, {"act": "pause", "when": when})


@router.post("/{identity}/resume", **_ACT)
async def resume_run(identity: Identity, service: Service, asking: Asking) -> Record:
    """Go on where a pause or an interruption has stopped; the gate opens at the same place of the path, at speed."""
    record = service.runs.read(identity)
    if service.fleet.state(identity) is RunState.INTERRUPTED:
        async with service.starting_run:
            _refuse_if_busy(service, service.plans.read(record["plan_id"]))
            await service.fleet.resume(identity)
        return _shown(service, service.runs.read(identity))
    return _pass_on(service, identity, asking, {"act": "resume"})


@router.post("/{identity}/stop", **_ACT)
async def stop_run(identity: Identity, service: Service, asking: Asking) -> Record:
    """Close the gate, decelerate to rest, and end the run."""
    return _pass_on(service, identity, asking, {"act": "stop"})


@router.post("/{identity}/abort", **_ACT)
async def abort_run(identity: Identity, service: Service, asking: Asking) -> Record:
    """Close the gate and stop all motion at once; a run that is over stays as it is. Open to every key."""
    return _pass_on(service, identity, asking, {"act": "abort"})


@router.post("/{identity}/estop", **_ACT)
async def estop_run(identity: Identity, service: Service, asking: Asking) -> Record:
    """Close the gate, stop all motion at once, switch the motors off, and let nothing move. Open to every key.

    Only switching the controller's power off and on, and homing, end it.
    """
    return _pass_on(service, identity, asking, {"act": "estop"})


@router.post("/{identity}/confirm", **_ACT)
async def confirm_run(identity: Identity, service: Service, asking: Asking) -> Record:
    """Confirm that the tool that the run waits for is mounted, and that the machine knows where it is."""
    return _pass_on(service, identity, asking, {"act": "confirm"})


@router.post("/{identity}/interlock", **_ACT)
async def push_interlock(identity: Identity, request: InterlockRequest, service: Service, asking: Asking) -> Record:
    """Push the value of an interlock, e.g. the beam current; out of its band the run pauses with the gate closed."""
    service.runs.read(identity)
    pushed = service.fleet.pushed_interlocks(identity)
    if request.name not in pushed:
        known = f"those of its machine are {', '.join(pushed)}" if pushed else "its machine file has none"
        raise ServiceError(
            422, f"runs/{identity}: {request.name!r} is no interlock that takes a pushed value", known, "bad_input"
        )
    return _pass_on(service, identity, asking, {"act": "interlock", **request.model_dump()})


@router.post("/{identity}/recover", **_ACT)
async def recover_run(identity: Identity, service: Service) -> Record:
    """Ask the controller again what a run has executed that did not end as planned, with the gate closed and at rest.

    The service does so by itself when a worker has died; this is for when the controller could not be reached then.
    """
    record = service.runs.read(identity)
    state = service.fleet.state(identity)
    if state not in AT_REST - {RunState.COMPLETED}:
        raise ServiceError(409, f"runs/{identity}: is {state}", "only a run that ended otherwise than as planned is")
    async with service.starting_run:
        _refuse_if_busy(service, service.plans.read(record["plan_id"]))
        await service.fleet.recover(identity)
    return _shown(service, service.runs.read(identity))


@router.get("/{identity}/files/{name}", response_class=FileResponse, responses=refusals(404, 409))
async def get_run_file(identity: Identity, name: Annotated[str, FileName], service: Service) -> FileResponse:
    """Download a file of a run that is over: run files, of every tool too, or what is left as a table or a picture."""
    record = service.runs.read(identity)
    if service.fleet.state(identity) not in AT_REST:
        raise ServiceError(409, f"runs/{identity}: is under way", "wait for its end")
    if name not in _files_of(service, identity):
        raise ServiceError(404, f"runs/{identity}: has no file of this name", "its links name those that it has")
    arguments = {
        "plan": str(service.plans.path(record["plan_id"], "plan.h5")),
        "run": str(service.runs.path(identity, "run.h5")),
    }
    return await file_on_demand(service.runs, identity, name, "run-files", arguments)


@router.delete("/{identity}", status_code=204, responses=refusals(404, 409, 412))
async def delete_run(identity: Identity, service: Service) -> None:
    """Delete the files of a run that is over; what it did stays in the journal."""
    service.runs.read(identity)
    if service.fleet.state(identity) not in AT_REST:
        raise ServiceError(409, f"runs/{identity}: is under way", "wait for its end or abort it")
    service.runs.delete(identity)


def _shown(service: State, record: Record) -> Record:
    identity = record["id"]
    state = service.fleet.state(identity)
    told = service.fleet.status(identity) or record.get("status")
    shown = linked(service.runs, record, _files_of(service, identity) if "figures" in record else ())
    return {**shown, "state": state, "status": told, "error": error_of(state, told)}


def _files_of(service: State, identity: str) -> tuple[str, ...]:
    """Return the names of a run's files; of several tools each has one of its own, which its rest is planned from."""
    return (*_FILES, *sorted(path.name for path in service.runs.path(identity, "").glob("run.tool*.h5")))


def _pass_on(service: State, identity: str, asking: Holder, act: dict[str, Any]) -> Record:
    """Hand an act to a run's worker; refuse one that the run's state does not allow."""
    record = service.runs.read(identity)
    state = service.fleet.state(identity)
    if state not in _MAY.get(act["act"], RunState):
        raise ServiceError(409, f"runs/{identity}: is {state}", f"a run that is {state} cannot {act['act']}")
    try:
        service.fleet.act(identity, {**act, "key": asking.key, "by": asking.name})
    except RunError as error:
        if act["act"] not in ("abort", "estop", "stop"):
            raise ServiceError(409, f"runs/{identity}: {error.message}", error.hint) from error
    return _shown(service, record)


async def _start(request: RunRequest, service: State, asking: Holder) -> Record:
    plan = service.plans.read(request.plan_id)
    if plan["state"] != "done":
        raise ServiceError(409, f"plans/{request.plan_id}: is not done", "wait until its state is done")
    machine = _refuse_if_busy(service, plan)
    identity = service.runs.create()
    emulated = service.emulator.controller if service.emulator is not None else None
    operator = request.operator or asking.name
    job = Job(
        run=identity,
        operator=operator,
        key=asking.key,
        simulated=emulated is not None,
        speed=emulated.time_scale if emulated is not None else 1.0,
        address=Address(host=emulated.host, port=emulated.port) if emulated is not None else None,
    )
    record = {"state": RunState.QUEUED, "plan_id": request.plan_id, "simulated": job.simulated, "operator": operator}
    written = service.runs.write(identity, record)
    try:
        await service.fleet.start(job, service.plans.path(request.plan_id, "plan.h5"), machine)
    except BaseException:
        service.runs.delete(identity)
        raise
    return written


def _refuse_if_busy(service: State, plan: Record) -> Path:
    """Return the machine file of a plan, unless something moves on that machine."""
    machine = machine_of_plan(service, plan)
    living = service.fleet.living
    busy = [run for run in living if service.settings.simulate or _machine_of_run(service, run) == machine]
    if busy:
        raise ServiceError(409, f"runs/{', '.join(busy)}: is under way", "wait for its end or abort it")
    if service.desk.busy:
        raise ServiceError(409, "machine: an act is under way", "wait for its end or abort it")
    return machine


def _machine_of_run(service: State, run: str) -> Path:
    plan = service.plans.read(service.runs.read(run)["plan_id"])
    return machine_of_plan(service, plan)
