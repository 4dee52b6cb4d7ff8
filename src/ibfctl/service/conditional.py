"""ETags: what has not changed is not sent again (If-None-Match), and nothing is deleted unseen (If-Match).

The ETag of a resource is a hash of what GET answers, so that no router has to think of it.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ibfctl.service.problems import MEDIA_TYPE, problem

_JSON = "application/json"


class Conditional:
    """Answer conditional requests for everything below."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if scope["method"] == "GET":
            await self._app(scope, receive, _Tagged(send, headers.get("if-none-match")))
        elif scope["method"] == "DELETE" and "if-match" in headers:
            present = await self._present(scope)
            if present is not None and not _matches(headers["if-match"], present):
                detail = f"{scope['path']}: has changed since it was read (its ETag is {present})"
                content = problem(412, "changed", detail, "read it again, and decide anew")
                await JSONResponse(content, 412, media_type=MEDIA_TYPE)(scope, receive, send)
                return
            await self._app(scope, receive, send)
        else:
            await self._app(scope, receive, send)

    async def _present(self, scope: Scope) -> str | None:
        """Return the ETag of what GET answers now; None where it answers nothing."""
        heard = _Heard()
        await self._app({**scope, "method": "GET", "state": dict(scope.get("state", {}))}, _nothing, heard)
        return _tag_of(heard.body) if heard.status == 200 else None


class _Tagged:
    """Passes an answer on with an ETag, or as 304 where the client has it already.

    The beginning of JSON is held back until its body is there; anything else is passed on as it comes.
    """

    def __init__(self, send: Send, known: str | None) -> None:
        self._send = send
        self._known = known
        self._start: Message | None = None

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start" and message["status"] == 200:
            headers = Headers(raw=message["headers"])
            if headers.get("content-type", "").startswith(_JSON) and "content-length" in headers:
                self._start = message
                return
            if self._known is not None and "etag" in headers and _matches(self._known, headers["etag"]):
                self._send = await _unchanged(self._send, headers["etag"])
                return
        if self._start is not None:
            start, self._start = self._start, None
            tag = _tag_of(message["body"])
            if self._known is not None and _matches(self._known, tag):
                self._send = await _unchanged(self._send, tag)
                return
            MutableHeaders(scope=start)["etag"] = tag
            await self._send(start)
        await self._send(message)


@dataclass
class _Heard:
    """An answer that is looked at and not sent."""

    status: int = 0
    body: bytes = b""

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.status = message["status"]
        else:
            self.body += message.get("body", b"")


async def _unchanged(send: Send, tag: str) -> Send:
    """Answer 304; what the application still says goes nowhere."""

    async def silent(message: Message) -> None:
        return None

    response = Response(status_code=304, headers={"etag": tag})
    await send({"type": "http.response.start", "status": 304, "headers": response.raw_headers})
    await send({"type": "http.response.body", "body": b""})
    return silent


async def _nothing() -> Message:
    return {"type": "http.request", "body": b"", "more_body": False}


def _tag_of(body: bytes) -> str:
    return f'"{hashlib.sha256(body).hexdigest()[:32]}"'


def _matches(given: str, tag: str) -> bool:
    tags = {part.strip().removeprefix("W/") for part in given.split(",")}
    return "*" in tags or tag in tags
