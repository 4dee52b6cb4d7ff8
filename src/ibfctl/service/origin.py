"""Requests that a page of the web has talked a browser into are refused: motion is not for strangers."""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from ibfctl.service.problems import MEDIA_TYPE, problem

_LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})


class LocalOnly:
    """Let pass only requests addressed to this computer by name, and from no other origin."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] == "http":
            headers = Headers(scope=scope)
            sources = [f"//{headers.get('host', '')}", *headers.getlist("origin")]
            if any(_host(source) not in _LOOPBACK for source in sources):
                content = problem(403, "foreign_origin", "request is not from this computer", "open it by 127.0.0.1")
                await JSONResponse(content, 403, media_type=MEDIA_TYPE)(scope, receive, send)
                return
        await self._app(scope, receive, send)


def _host(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None
