"""Errors as RFC 9457 problem JSON, with a stable `code` and a `hint` for the operator."""

from __future__ import annotations

import errno
import re
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from ibfctl.errors import IbfctlError

MEDIA_TYPE = "application/problem+json"
_STATUS = {"bad_input": 422, "limits": 422, "solver": 422, "controller": 502, "link": 502}
_CODES = {404: "not_found", 405: "method_not_allowed", 409: "conflict", 413: "too_large"}

_CORRECT = "correct the request; GET /openapi.json describes it"


class Problem(BaseModel):
    """Why a request, a plan or a run failed (RFC 9457).

    `code` is stable and for programs; `detail` and `hint` are for people.
    """

    type: str
    title: str
    status: int
    detail: str
    code: str
    hint: str


class ServiceError(IbfctlError):
    """A request that the service refuses with an HTTP status; `kind` is the problem's code."""

    def __init__(self, status: int, message: str, hint: str = "", kind: str = "") -> None:
        super().__init__(message, hint)
        self.status = status
        self.kind = kind or _CODES.get(status, "refused")


def problem(status: int, code: str, detail: str, hint: str = "") -> dict[str, Any]:
    """Return the members of a problem."""
    return Problem(
        type=f"urn:ibfctl:problem:{code}",
        title=HTTPStatus(status).phrase,
        status=status,
        detail=detail,
        code=code,
        hint=hint,
    ).model_dump()


def install(app: FastAPI) -> None:
    """Make every error of the app a problem."""

    @app.exception_handler(ServiceError)
    async def refused(request: Request, error: ServiceError) -> JSONResponse:
        return _answer(problem(error.status, error.kind, error.message, error.hint))

    @app.exception_handler(IbfctlError)
    async def failed(request: Request, error: IbfctlError) -> JSONResponse:
        return _answer(problem(_STATUS.get(error.code, 409), error.code, error.message, error.hint))

    @app.exception_handler(Exception)
    async def broken(request: Request, error: Exception) -> JSONResponse:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            return _answer(problem(507, "disk_full", "the service's disk is full", "make room in its data folder"))
        return _answer(problem(500, "internal", "the service has failed to answer", "see the service's log"))

    @app.exception_handler(HTTPException)
    async def unknown(request: Request, error: HTTPException) -> JSONResponse:
        if error.status_code == HTTPStatus.BAD_REQUEST:  # a body that is no JSON
            return _answer(problem(422, "bad_request", str(error.detail), _CORRECT))
        headers = error.headers
        if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
            headers = {"Allow": ", ".join(_allowed(app, request.url.path))}
        code = _CODES.get(error.status_code, "refused")
        hint = "GET /openapi.json lists all operations"
        return _answer(problem(error.status_code, code, str(error.detail), hint), headers)

    @app.exception_handler(RequestValidationError)
    async def invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        faults = (f"{'.'.join(str(part) for part in fault['loc'])}: {fault['msg']}" for fault in error.errors())
        return _answer(problem(422, "bad_request", "; ".join(faults), _CORRECT))


def _allowed(app: FastAPI, path: str) -> list[str]:
    """Return the methods of a path; the router itself knows those of the first route only."""
    methods: set[str] = set()
    for template, operations in app.openapi()["paths"].items():
        if re.fullmatch(re.sub(r"\{\w+\}", "[^/]+", template), path):
            methods.update(method.upper() for method in operations)
    return sorted(methods)


def _answer(content: dict[str, Any], headers: Mapping[str, str] | None = None) -> JSONResponse:
    return JSONResponse(content, content["status"], headers, MEDIA_TYPE)
