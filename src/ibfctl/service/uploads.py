"""Uploads: the raw body goes to a file of the service's own naming, and is read by a process of its own."""

from __future__ import annotations

import hashlib
import shutil
from typing import Any, Literal

from fastapi import Request

from ibfctl.service.children import TASKS, Child
from ibfctl.service.problems import ServiceError
from ibfctl.service.settings import Settings
from ibfctl.service.store import Collection, Record

Format = Literal["npz", "mat", "csv", "xyz"]
TOO_LARGE: dict[int | str, dict[str, Any]] = {
    413: {"description": "The body is larger than the service accepts."}
}


async def store_upload(
    request: Request,
    settings: Settings,
    collection: Collection,
    form: Format,
    task: str,
    given: dict[str, Any],
) -> Record:
    """Store the body of a request, have it read, and return the record of the new resource.

    Raises
    ------
    ServiceError
        If the body is too large, or is no readable file of its kind; nothing is kept then.
    """
    identity = collection.create()
    path = collection.path(identity, f"upload.{form}")
    try:
        digest = hashlib.sha256()
        size = 0
        with path.open("wb") as stream:
            async for chunk in request.stream():
                size += len(chunk)
                if size > settings.max_upload_bytes:
                    raise ServiceError(
                        413, f"body is larger than {settings.max_upload_bytes} bytes", "crop or bin the map"
                    )
                digest.update(chunk)
                stream.write(chunk)
        figures = await inspect(
            task, {**given, ("path" if task == "inspect-map" else "spec"): str(path)}, path.name
        )
        return collection.write(
            identity,
            {"format": form, "bytes": size, "sha256": digest.hexdigest(), "given": given, "figures": figures},
        )
    except BaseException:
        shutil.rmtree(collection.path(identity, ""))
        raise


async def inspect(task: str, arguments: dict[str, Any], shown_as: str) -> dict[str, Any]:
    """Return the figures of an input; what refuses it names the upload instead of a path of the service."""
    child = await Child.start(TASKS, [task], arguments)
    event = await child.last_event(lambda progress: None)
    if event["event"] == "failed":
        place = str(arguments.get("path") or arguments.get("spec"))
        raise ServiceError(422, event["message"].replace(place, shown_as), event["hint"], event["code"])
    figures: dict[str, Any] = event["figures"]
    return figures
