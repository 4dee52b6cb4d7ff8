"""Surface maps: upload, list, show."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request

from ibfctl.service.state import Service
from ibfctl.service.uploads import TOO_LARGE, Format, store_upload

router = APIRouter(prefix="/maps", tags=["maps"])


@router.post("", status_code=201, responses=TOO_LARGE)
async def add_map(
    request: Request,
    service: Service,
    format: Annotated[Format, Query(description="Kind of file in the body.")],
    pixel_mm: Annotated[
        float | None, Query(description="Pixel size, mm, where the file does not say it.")
    ] = None,
    unit: Annotated[str | None, Query(description="Unit of heights where the file does not say it.")] = None,
    array: Annotated[
        str | None, Query(description="Array of a .mat file; default Z_to_remove, else Z.")
    ] = None,
) -> dict[str, Any]:
    """Upload a map as the raw body; answers its id and figures."""
    given = {"pixel_mm": pixel_mm, "unit": unit, "array": array}
    return await store_upload(request, service.settings, service.maps, format, "inspect-map", given)


@router.get("")
async def list_maps(service: Service) -> list[dict[str, Any]]:
    """List all maps, oldest first."""
    return service.maps.records()


@router.get("/{identity}")
async def show_map(identity: str, service: Service) -> dict[str, Any]:
    """Show a map's figures."""
    return service.maps.read(identity)
