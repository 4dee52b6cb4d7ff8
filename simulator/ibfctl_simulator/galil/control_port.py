"""The control port: lines of the back door over TCP."""

from __future__ import annotations

import asyncio

from ibfctl_simulator.galil.control import apply_command
from ibfctl_simulator.galil.server import Emulator

LONGEST_LINE_BYTES = 1000


class ControlPort:
    """Listens for lines and answers each with `ok` or `error: ...`."""

    def __init__(self, emulator: Emulator) -> None:
        self.port = 0
        self._emulator = emulator
        self._server: asyncio.Server | None = None
        self._open: set[asyncio.Transport] = set()

    async def start(self, host: str, port: int) -> None:
        """Listen; `port` then tells where.

        Raises
        ------
        OSError
            If the address cannot be bound.
        """
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: _Door(self._emulator, self._open), host, port)
        self.port = self._server.sockets[0].getsockname()[1]

    def stop(self) -> None:
        """Close the port and its connections."""
        if self._server is not None:
            self._server.close()
        for transport in list(self._open):
            transport.abort()


class _Door(asyncio.Protocol):
    """One connection."""

    def __init__(self, emulator: Emulator, connections: set[asyncio.Transport]) -> None:
        self._emulator = emulator
        self._connections = connections
        self._transport: asyncio.Transport | None = None
        self._rest = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._connections.add(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._transport is not None:
            self._connections.discard(self._transport)

    def data_received(self, data: bytes) -> None:
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            if line.strip():
                self._answer(self._outcome(line.decode("latin-1").strip()))
        if len(self._rest) > LONGEST_LINE_BYTES:
            self._answer("error: line too long")
            self._rest = b""
            if self._transport is not None:
                self._transport.close()

    def _outcome(self, line: str) -> str:
        try:
            apply_command(self._emulator, line)
        except ValueError as error:
            return f"error: {error}"
        return "ok"

    def _answer(self, text: str) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(f"{text}\n".encode("latin-1", "replace"))
