"""Tool influence functions: upload or make from a formula, list, show."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request

from ibfctl.service.problems import ServiceError
from ibfctl.service.state import Service
from ibfctl.service.uploads import TOO_LARGE, Format, inspect, store_upload

router = APIRouter(prefix="/influences", tags=["influences"])


@router.post("", status_code=201, responses=TOO_LARGE)
async def add_influence(
    request: Request,
    service: Service,
    format: Annotated[Format | None, Query(description="Kind of file in the body.")] = None,
    formula: Annotated[
        str | None, Query(description="Instead of a body: gaussian:fwhm_mm=..,peak_nm_s=..,radius_mm=..")
    ] = None,
    pixel_mm: Annotated[
        float | None, Query(description="Pixel size, mm, where the file does not say it.")
    ] = None,
    unit: Annotated[str | None, Query(description="Unit of rates where the file does not say it.")] = None,
) -> dict[str, Any]:
    """Upload an influence function as the raw body, or give a formula; answers its id and figures."""
    given = {"pixel_mm": pixel_mm, "unit": unit}
    if format is not None and formula is None:
        return await store_upload(
            request, service.settings, service.influences, format, "inspect-influence", given
        )
    if formula is None or format is not None or not formula.startswith("gaussian:"):
        raise ServiceError(
            422, "needs either format and a body, or a formula", "formula=gaussian:fwhm_mm=..,.."
        )
    figures = await inspect("inspect-influence", {**given, "spec": formula}, formula)
    identity = service.influences.create()
    return service.influences.write(identity, {"formula": formula, "given": given, "figures": figures})


@router.get("")
async def list_influences(service: Service) -> list[dict[str, Any]]:
    """List all influence functions, oldest first."""
    return service.influences.records()


@router.get("/{identity}")
async def show_influence(identity: str, service: Service) -> dict[str, Any]:
    """Show an influence function's figures."""
    return service.influences.read(identity)
