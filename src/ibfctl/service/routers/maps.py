"""Surface maps: upload, list, show, preview, delete."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.responses import FileResponse

from ibfctl.service.bodies import BODY
from ibfctl.service.models import MapRecord, Page
from ibfctl.service.requests import After, IdempotencyKey, Identity, Limit, file_on_demand, linked, page, refusals
from ibfctl.service.state import Service
from ibfctl.service.store import Record
from ibfctl.service.uploads import Format, store_upload

router = APIRouter(prefix="/maps", tags=["maps"])
_FILES = ("preview.png",)


@router.post("", status_code=201, response_model=MapRecord, responses=refusals(409, 413), openapi_extra=BODY)
async def add_map(
    request: Request,
    service: Service,
    format: Annotated[Format, Query(description="Kind of file in the body.")],
    pixel_mm: Annotated[float | None, Query(description="Pixel size where the file does not say it.")] = None,
    unit: Annotated[str | None, Query(description="Unit of heights where the file does not say it.")] = None,
    array: Annotated[str | None, Query(description="Array of a .mat or HDF5 file; default: Z_to_remove, Z.")] = None,
    key: IdempotencyKey = None,
) -> Record:
    """Upload a map as the raw body; answers its id and figures."""
    given = {"pixel_mm": pixel_mm, "unit": unit, "array": array}
    made = await store_upload(request, service.settings, service.maps, format, "inspect-map", given, key)
    return linked(service.maps, made, _FILES)


@router.get("", response_model=Page[MapRecord], response_model_exclude_none=True, responses=refusals())
async def list_maps(service: Service, limit: Limit = 100, after: After = None) -> dict[str, Any]:
    """List maps."""
    return page(service.maps, limit, after, lambda record: linked(service.maps, record, _FILES))


@router.get("/{identity}", response_model=MapRecord, responses=refusals(404))
async def show_map(identity: Identity, service: Service) -> Record:
    """Show a map's figures."""
    return linked(service.maps, service.maps.read(identity), _FILES)


@router.get("/{identity}/files/preview.png", response_class=FileResponse, responses=refusals(404))
async def preview_map(identity: Identity, service: Service) -> FileResponse:
    """Show a picture of a map."""
    source = {"path": service.upload_of(service.maps, identity), **service.maps.read(identity)["given"]}
    return await file_on_demand(service.maps, identity, "preview.png", "preview-map", {"map": source})


@router.delete("/{identity}", status_code=204, responses=refusals(404, 409, 412))
async def delete_map(identity: Identity, service: Service) -> None:
    """Delete a map that no plan refers to."""
    service.maps.read(identity)
    service.refuse_if_used("maps", identity, service.plans)
    service.maps.delete(identity)
