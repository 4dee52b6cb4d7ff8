"""The audit log: every request that changes something or moves something, with the key it came by, in the journal."""

from __future__ import annotations

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ibfctl.service.access import SAFE_METHODS, Holder


class Audited:
    """Records the acts that were let in; what they did to a run, its worker records as well."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http" or scope["method"] in SAFE_METHODS:
            await self._app(scope, receive, send)
            return
        status = 500

        async def heard(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._app(scope, receive, heard)
        finally:
            holder = Holder.of(scope)
            client = scope.get("client")
            act = {"act": f"{scope['method']} {scope['path']}", "by": holder.name, "status": status}
            scope["app"].state.service.record("act", {**act, "client": client[0] if client else None}, holder.key)
