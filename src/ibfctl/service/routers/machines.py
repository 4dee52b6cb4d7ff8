"""Machine files: limits to plan for, and the controller that a run is streamed to."""

from __future__ import annotations

import hashlib
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse

from ibfctl.machine.description import parse_machine
from ibfctl.service.bodies import BODY, content_of
from ibfctl.service.models import MachineRecord, Page
from ibfctl.service.problems import ServiceError
from ibfctl.service.requests import After, IdempotencyKey, Identity, Limit, linked, page, refusals
from ibfctl.service.state import Service, State
from ibfctl.service.store import Record, fingerprint_of

router = APIRouter(prefix="/machines", tags=["machines"])
MACHINE_FILE = "machine.toml"
_MOST_BYTES = 1 << 16


@router.post("", status_code=201, response_model=MachineRecord, responses=refusals(409, 413), openapi_extra=BODY)
async def add_machine(request: Request, service: Service, key: IdempotencyKey = None) -> Record:
    """Add a machine file; a plan that names its id is made for that machine, and run on it."""
    content = b"".join([piece async for piece in content_of(request, _MOST_BYTES)])
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ServiceError(422, f"machine file: is no UTF-8 ({error})", "send TOML", "bad_input") from error
    machine = parse_machine(text, "in the body")
    sha256 = hashlib.sha256(content).hexdigest()
    collection, fingerprint = service.machines, fingerprint_of(sha256)
    record = collection.recall(key, fingerprint)
    if record is None:
        identity = collection.create()
        collection.path(identity, MACHINE_FILE).write_bytes(content)
        record = collection.write(identity, {"sha256": sha256, "machine": machine.model_dump(mode="json")})
        collection.remember(key, fingerprint, identity)
    return _shown(service, record)


@router.get("", response_model=Page[MachineRecord], response_model_exclude_none=True, responses=refusals())
async def list_machines(service: Service, limit: Limit = 100, after: After = None) -> dict[str, Any]:
    """List machine files."""
    return page(service.machines, limit, after, lambda record: _shown(service, record))


@router.get("/{identity}", response_model=MachineRecord, responses=refusals(404))
async def show_machine(identity: Identity, service: Service) -> Record:
    """Show a machine: all keys of its file, with defaults."""
    return _shown(service, service.machines.read(identity))


@router.get("/{identity}/files/machine.toml", response_class=FileResponse, responses=refusals(404))
async def get_machine_file(identity: Identity, service: Service) -> FileResponse:
    """Download a machine file as it was added."""
    service.machines.read(identity)
    return FileResponse(service.machines.path(identity, MACHINE_FILE), filename=MACHINE_FILE)


@router.delete("/{identity}", status_code=204, responses=refusals(404, 409, 412))
async def delete_machine(identity: Identity, service: Service) -> None:
    """Delete a machine file that no plan refers to."""
    service.machines.read(identity)
    service.refuse_if_used("machines", identity, service.plans)
    service.machines.delete(identity)


def _shown(service: State, record: Record) -> Record:
    return linked(service.machines, record, (MACHINE_FILE,))
