"""Uploads: the raw body goes to a file of the service's own naming, and is read by a process of its own."""

from __future__ import annotations

import hashlib
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Literal

from fastapi import Request

from ibfctl.service.bodies import content_of
from ibfctl.service.children import TASKS, Child
from ibfctl.service.problems import ServiceError
from ibfctl.service.settings import Settings
from ibfctl.service.store import Collection, Record, fingerprint_of

Format = Literal["npz", "mat", "csv", "xyz", "dat", "datx", "h5", "fits", "tif"]


async def store_upload(
    request: Request,
    settings: Settings,
    collection: Collection,
    form: Format,
    task: str,
    given: dict[str, Any],
    key: str | None,
) -> Record:
    """Store a map or an influence function, have it read, and return the record of the new resource.

    Parameters
    ----------
    task
        Which task reads it and finds its figures.
    given
        What was given beside the body.
    key
        Idempotency key: a request that was made before returns what it made then.

    Raises
    ------
    ServiceError
        If the body is too large, or is no readable file of its kind; nothing is kept then.
    """
    place = "path" if task == "inspect-map" else "spec"

    async def of(path: Path, size: int, sha256: str) -> Record:
        asked = {**given, place: str(path), "max_pixels": settings.max_map_pixels}
        figures = await inspect(collection, task, asked, path.name)
        return {"format": form, "bytes": size, "sha256": sha256, "given": given, "figures": figures}

    return await store_body(request, settings, collection, f"upload.{form}", (form, given), key, of)


async def store_body(
    request: Request,
    settings: Settings,
    collection: Collection,
    name: str,
    given: Any,
    key: str | None,
    of: Callable[[Path, int, str], Awaitable[Record]],
) -> Record:
    """Store the body of a request as the file `name` of a new resource, and return its record.

    Parameters
    ----------
    given
        What was given beside the body; the same of both with the same key makes nothing new.
    of
        Makes the record of the file, its size and its SHA-256, or refuses it.

    Raises
    ------
    ServiceError
        If the body is too large, or refused; nothing is kept then.
    """
    identity = collection.create()
    path = collection.path(identity, name)
    kept = False
    try:
        size, sha256 = await _receive(request, path, settings.max_upload_bytes)
        fingerprint = fingerprint_of(given, sha256)
        async with collection.making(key):
            earlier = collection.recall(key, fingerprint)
            if earlier is not None:
                return earlier
            record = collection.write(identity, await of(path, size, sha256))
            collection.remember(key, fingerprint, identity)
            kept = True
            return record
    finally:
        if not kept:
            collection.delete(identity)


async def inspect(collection: Collection, task: str, arguments: dict[str, Any], shown_as: str) -> dict[str, Any]:
    """Return the figures of an input; what refuses it names the upload instead of a path of the service."""
    async with collection.hands:
        child = await Child.start(TASKS, [task], arguments)
        event = await child.last_event(lambda progress: None)
    if event["event"] == "failed":
        place = str(arguments.get("path") or arguments.get("spec"))
        raise ServiceError(422, event["message"].replace(place, shown_as), event["hint"], event["code"])
    figures: dict[str, Any] = event["figures"]
    return figures


async def _receive(request: Request, path: Path, limit: int) -> tuple[int, str]:
    """Write the body to a file as it arrives; return its size and SHA-256."""
    digest = hashlib.sha256()
    size = 0
    with path.open("wb") as stream:
        async for piece in content_of(request, limit):
            size += len(piece)
            digest.update(piece)
            stream.write(piece)
    return size, digest.hexdigest()
