"""Tool influence functions: upload or make from a formula, list, show, delete."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request

from ibfctl.service.bodies import BODY
from ibfctl.service.models import InfluenceRecord, Page
from ibfctl.service.problems import ServiceError
from ibfctl.service.requests import After, IdempotencyKey, Identity, Limit, linked, page, refusals
from ibfctl.service.state import Service
from ibfctl.service.store import Record, fingerprint_of
from ibfctl.service.uploads import Format, inspect, store_upload

router = APIRouter(prefix="/influences", tags=["influences"])
_FORMULA = "gaussian:"


@router.post(
    "",
    status_code=201,
    response_model=InfluenceRecord,
    response_model_exclude_none=True,
    responses=refusals(409, 413),
    openapi_extra=BODY,
)
async def add_influence(
    request: Request,
    service: Service,
    format: Annotated[Format | None, Query(description="Kind of file in the body.")] = None,
    formula: Annotated[
        str | None, Query(description="Instead of a body: gaussian:fwhm_mm=..,peak_nm_s=..,radius_mm=..")
    ] = None,
    pixel_mm: Annotated[float | None, Query(description="Pixel size where the file does not say it.")] = None,
    unit: Annotated[str | None, Query(description="Unit of rates where the file does not say it.")] = None,
    key: IdempotencyKey = None,
) -> Record:
    """Upload an influence function as the raw body, or give a formula; answers its id and figures."""
    given = {"pixel_mm": pixel_mm, "unit": unit}
    collection = service.influences
    if format is not None and formula is None:
        made = await store_upload(request, service.settings, collection, format, "inspect-influence", given, key)
        return linked(collection, made)
    if formula is None or format is not None or not formula.startswith(_FORMULA):
        raise ServiceError(422, "needs either format and a body, or a formula", f"formula={_FORMULA}fwhm_mm=..,..")
    fingerprint = fingerprint_of(formula, given)
    async with collection.making(key):
        earlier = collection.recall(key, fingerprint)
        if earlier is not None:
            return linked(collection, earlier)
        asked = {**given, "spec": formula, "max_pixels": service.settings.max_map_pixels}
        figures = await inspect(collection, "inspect-influence", asked, formula)
        identity = collection.create()
        collection.remember(key, fingerprint, identity)
        return linked(collection, collection.write(identity, {"formula": formula, "given": given, "figures": figures}))


@router.get("", response_model=Page[InfluenceRecord], response_model_exclude_none=True, responses=refusals())
async def list_influences(service: Service, limit: Limit = 100, after: After = None) -> dict[str, Any]:
    """List influence functions."""
    return page(service.influences, limit, after, lambda record: linked(service.influences, record))


@router.get("/{identity}", response_model=InfluenceRecord, response_model_exclude_none=True, responses=refusals(404))
async def show_influence(identity: Identity, service: Service) -> Record:
    """Show an influence function's figures."""
    return linked(service.influences, service.influences.read(identity))


@router.delete("/{identity}", status_code=204, responses=refusals(404, 409, 412))
async def delete_influence(identity: Identity, service: Service) -> None:
    """Delete an influence function that no plan refers to."""
    service.influences.read(identity)
    service.refuse_if_used("influences", identity, service.plans)
    service.influences.delete(identity)
