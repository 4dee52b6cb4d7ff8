"""Who may ask for what: with keys their holders by role; without, this computer alone."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from ibfctl.service.keys import KeyRing, Role
from ibfctl.service.problems import MEDIA_TYPE, problem

OPEN_PATHS = frozenset({"/healthz", "/readyz", "/openapi.json", "/docs"})
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
_FOR_EVERY_KEY = ("/abort", "/estop")  # who sees a danger may end it
_ADMIN_PREFIX = "/v1/machines"  # machine files hold the limits, and where runs are sent to
_LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})


@dataclass(frozen=True)
class Holder:
    """Who asks: the name and the id of the key; without keys whoever is at this computer."""

    name: str = "local"
    key: str | None = None

    @classmethod
    def of(cls, scope: Scope) -> Holder:
        """Return who was let in with a request."""
        found: Holder = scope.get("state", {}).get("holder", cls())
        return found


def needed_role(method: str, path: str) -> Role:
    """Return what a key must be allowed for a request."""
    if method in SAFE_METHODS or path.endswith(_FOR_EVERY_KEY):
        return Role.VIEW
    return Role.ADMIN if path.startswith(_ADMIN_PREFIX) else Role.OPERATE


class Access:
    """Let pass a request whose key may do it; where there are no keys, only one from this computer itself.

    Without keys a request must come over the loopback, be addressed to this computer by name, and have no other origin:
    a page of the web may talk a browser into anything, and motion is not for strangers.
    """

    def __init__(self, app: ASGIApp, keys: KeyRing) -> None:
        self._app = app
        self._keys = keys

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] == "http" and scope["path"] not in OPEN_PATHS:
            refusal = self._by_key(scope) if self._keys.all_keys() else _by_place(scope)
            if refusal is not None:
                await refusal(scope, receive, send)
                return
        await self._app(scope, receive, send)

    def _by_key(self, scope: Scope) -> JSONResponse | None:
        kind, _, token = Headers(scope=scope).get("authorization", "").partition(" ")
        key = self._keys.find(token.strip()) if kind.lower() == "bearer" else None
        if key is None:
            hint = "send the header `Authorization: Bearer TOKEN`; `ibfctl keys add` makes one"
            return _refusal(401, "unauthorized", "the request has no valid key", hint)
        needed = needed_role(scope["method"], scope["path"])
        if key.may < needed:
            detail = f"key {key.name} may {key.role}, this needs {needed.name.lower()}"
            return _refusal(403, "forbidden", detail, "use a key with that role")
        scope.setdefault("state", {})["holder"] = Holder(key.name, key.id)
        return None


def _by_place(scope: Scope) -> JSONResponse | None:
    headers = Headers(scope=scope)
    sources = [f"//{headers.get('host', '')}", *headers.getlist("origin")]
    if _is_local(scope.get("client")) and all(_host(source) in _LOOPBACK for source in sources):
        return None
    return _refusal(403, "foreign_origin", "request is not from this computer", "open it by 127.0.0.1, or add keys")


def _is_local(client: tuple[str, int] | None) -> bool:
    return client is not None and ipaddress.ip_address(client[0]).is_loopback


def _host(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None


def _refusal(status: int, code: str, detail: str, hint: str) -> JSONResponse:
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    return JSONResponse(problem(status, code, detail, hint), status, headers, MEDIA_TYPE)
