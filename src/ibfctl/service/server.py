"""The server: uvicorn, told to end streams of events before it waits for their listeners."""

from __future__ import annotations

import socket

import uvicorn
from fastapi import FastAPI

from ibfctl.service.state import State


class Server(uvicorn.Server):
    """Serves one application until it is told to exit.

    Parameters
    ----------
    app
        Of `create_app`.
    certificate, key
        PEM files for HTTPS, if that is wanted.
    """

    def __init__(self, app: FastAPI, certificate: str | None = None, key: str | None = None) -> None:
        config = uvicorn.Config(
            app, log_level="warning", access_log=False, lifespan="on", ssl_certfile=certificate, ssl_keyfile=key
        )
        super().__init__(config)
        self._app = app

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End in order: no listener may hold up the end."""
        state: State = self._app.state.service
        state.events.close()
        await super().shutdown(sockets)
