"""What all routers share: parameters, pages, files on demand, and the problems that an operation may answer."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import Annotated, Any

from fastapi import Header, Path, Query, Request
from fastapi.responses import FileResponse
from pydantic import BeforeValidator, Field

from ibfctl.service.children import TASKS, Child
from ibfctl.service.problems import MEDIA_TYPE, ServiceError
from ibfctl.service.store import Collection, Record


def _digits(value: object) -> object:
    if isinstance(value, str) and not (value.isascii() and value.isdecimal()):
        raise ValueError("give digits alone")
    return value


Digits = BeforeValidator(_digits)
"""For integers in a query or a header, where `1.0` would be taken for one; after their bounds."""
IdempotencyKey = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        min_length=1,
        max_length=200,
        description="A request that is repeated with the same key makes nothing new.",
    ),
]
Identity = Annotated[str, Path(description="Id of the resource.", examples=["019ab2c4d5e6f708"])]
FileName = Path(description="Name of the file, as in the links of its resource.")
Limit = Annotated[int, Field(ge=1, le=1000), Digits, Query(description="Most items on a page.")]
After = Annotated[str | None, Query(min_length=1, description="Id of the last item of the page before.")]

_MEANINGS = {
    401: "There are keys, and the request has none of them.",
    403: "The key's role does not allow this; without keys: the request comes from another computer or a foreign page.",
    404: "There is no such resource.",
    409: "Not now, or not so: the problem says why.",
    412: "If-Match was given, and the resource has changed.",
    413: "The body is larger than the service accepts.",
    422: "The request cannot be carried out as it is.",
    503: "The service cannot take on work; the problem says why.",
}


def refusals(*statuses: int, also: tuple[int, ...] = (401, 403, 422)) -> dict[int | str, dict[str, Any]]:
    """Describe the problems that an operation may answer, for its documentation; `also` those of nearly all."""
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {status: {"description": _MEANINGS[status], "content": content} for status in (*also, *statuses)}


async def refuse_unknown_query(request: Request) -> None:
    """Refuse a name in the query that the operation does not know, or that comes twice: a slip would be a default."""
    paths, place = request.app.openapi()["paths"], request.scope["route"].path
    operations = paths.get(f"/v1{place}") or paths.get(place, {})
    described = operations.get(request.method.lower(), {})
    known = {parameter["name"] for parameter in described.get("parameters", ()) if parameter["in"] == "query"}
    names = [name for name, _ in request.query_params.multi_items()]
    wrong = sorted({name for name in names if name not in known or names.count(name) > 1})
    if wrong:
        hint = f"once each of {', '.join(sorted(known)) or 'none'}"
        raise ServiceError(
            422, f"query: {', '.join(wrong)[:200]} is not known here, or given twice", hint, "bad_request"
        )


def page(collection: Collection, limit: int, after: str | None, show: Callable[[Record], Record]) -> dict[str, Any]:
    """Return one page of a collection, oldest first."""
    found = list(islice(collection.ids(after or ""), limit + 1))
    shown = found[:limit]
    more = f"/v1/{collection.kind}?limit={limit}&after={shown[-1]}" if len(found) > limit else None
    return {"items": [show(collection.read(identity)) for identity in shown], "next": more}


def linked(collection: Collection, record: Record, names: tuple[str, ...] = ()) -> Record:
    """Return a record with links to itself and to its files."""
    place = f"/v1/{collection.kind}/{record['id']}"
    return {**record, "links": {"self": place, **{name: f"{place}/files/{name}" for name in names}}}


async def file_on_demand(
    collection: Collection, identity: str, name: str, task: str, arguments: dict[str, Any]
) -> FileResponse:
    """Answer a file of a resource; a task makes it, and its kin, when it is first asked for."""
    path = collection.path(identity, name)
    async with collection.making(identity), collection.hands:  # a page asks for all its pictures at once
        if not path.is_file():
            child = await Child.start(TASKS, [task], {**arguments, "folder": str(path.parent)})
            event = await child.last_event(lambda progress: None)
            if event["event"] == "failed":
                raise ServiceError(422, event["message"], event["hint"], event["code"])
    if not path.is_file():
        raise ServiceError(409, f"{collection.kind}/{identity}: has no {name}", "see its links for what it has")
    return FileResponse(path, filename=name)
