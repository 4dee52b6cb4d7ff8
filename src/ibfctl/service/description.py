"""What /openapi.json says beyond what the routers say themselves: keys, roles, and what groups of operations are."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from ibfctl.service.access import OPEN_PATHS, needed_role

_TAGS = {
    "maps": "Surface maps, uploaded as files; heights in nm, positive where material must go.",
    "influences": "Tool influence functions: removal rates in nm/s, from a file or a formula.",
    "machines": "Machine files: limits to plan for, and where runs are sent to.",
    "plans": "Dwell times and motion for a map, an influence function and a machine; solved in the background.",
    "runs": "Plans streamed to a controller, each by a worker process of its own.",
    "machine": "The machine of this service between runs: positions in mm of the machine, gate closed.",
    "events": "What happens, as it happens.",
    "info": "The service itself.",
}
_DESCRIPTION = """\
Units are in the names of fields: `_mm`, `_s`, `_nm`, `_mm_s` and so on. What takes long answers 202 with a `Location`.
Errors are problem JSON (RFC 9457) with a stable `code` and a `hint`. Every operation names the role that a key needs in
`x-ibfctl-role`; a service without keys serves its own computer alone and asks for none.
"""
_SCHEME = {"type": "http", "scheme": "bearer", "description": "A token of `ibfctl keys add`, where there are keys."}


def describe(app: FastAPI) -> None:
    """Complete the description of an app's operations."""

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _described(app)
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]  # as FastAPI documents it


def _described(app: FastAPI) -> dict[str, Any]:
    tags = [{"name": name, "description": text} for name, text in _TAGS.items()]
    described = get_openapi(
        title=app.title,
        version=app.version,
        summary=app.summary,
        description=_DESCRIPTION,
        routes=app.routes,
        tags=tags,
    )
    described["components"]["securitySchemes"] = {"key": _SCHEME}
    for path, operations in described["paths"].items():
        for method, operation in operations.items():
            if path not in OPEN_PATHS:
                operation["security"] = [{"key": []}]
                operation["x-ibfctl-role"] = needed_role(method.upper(), path).name.lower()
    return described
