"""The TCP side: connections, the tick that lets time pass, and a server that runs in a thread."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self, TypeVar

from ibfctl_simulator.galil.clock import Clock, SteppedClock
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.errors import LOST_CONNECTION
from ibfctl_simulator.galil.framing import Framing
from ibfctl_simulator.galil.handles import Handle, Handles
from ibfctl_simulator.galil.interpreter import Interpreter

TICK_S = 0.005
_RESET_ON_CLOSE = struct.pack("ii", 1, 0)

T = TypeVar("T")


class Emulator:
    """A controller, its clock and its handles, listening on a TCP port of the running event loop.

    Parameters
    ----------
    controller
        What the clients talk to.
    clock
        Tells how much simulated time has passed.
    """

    def __init__(self, controller: Controller, clock: Clock) -> None:
        self.controller = controller
        self.clock = clock
        self.handles = Handles()
        self.interpreter = Interpreter(controller, self.handles)
        self.host = ""
        self.port = 0
        self._server: asyncio.Server | None = None
        self._tick: asyncio.Task[None] | None = None
        self._connections: set[_Connection] = set()

    async def start(self, host: str, port: int) -> None:
        """Listen; `host` and `port` then tell where.

        Raises
        ------
        OSError
            If the address cannot be bound.
        """
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: _Connection(self), host, port)
        self.host, self.port = self._server.sockets[0].getsockname()[:2]
        self._tick = loop.create_task(self._run_ticks())

    async def stop(self) -> None:
        """Close the port and all connections."""
        if self._tick is not None:
            self._tick.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._tick
        for connection in list(self._connections):
            connection.reset()
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()
        while self._connections:
            await asyncio.sleep(0)

    @property
    def ticking(self) -> asyncio.Task[None]:
        """The task that lets time pass; it ends by itself only if something is wrong."""
        assert self._tick is not None
        return self._tick

    def catch_up(self) -> None:
        """Let the controller's time catch up with the clock."""
        self.controller.advance_to(self.clock.now_s())

    def opened(self, connection: _Connection) -> None:
        """Remember a connection."""
        self._connections.add(connection)

    def closed(self, connection: _Connection) -> None:
        """Forget a connection."""
        self._connections.discard(connection)

    async def _run_ticks(self) -> None:
        while True:
            await asyncio.sleep(TICK_S)
            self.catch_up()


class _Connection(asyncio.Protocol):
    """One client."""

    def __init__(self, emulator: Emulator) -> None:
        self._emulator = emulator
        self._framing = Framing(emulator.controller.settings.line_characters)
        self._transport: asyncio.Transport | None = None
        self._handle: Handle | None = None
        self._reset_by_us = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._emulator.opened(self)
        connected = transport.get_extra_info("socket")
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        address, port = transport.get_extra_info("peername")[:2]
        self._handle = self._emulator.handles.open(address, port, self.reset)
        if self._handle is None:
            self.reset()

    def data_received(self, data: bytes) -> None:
        if self._handle is None or self._reset_by_us or self._transport is None:
            return
        self._emulator.catch_up()
        self._framing.push(data)
        replies = "".join(self._replies(self._handle.letter))
        self._transport.write(replies.encode("latin-1"))

    def connection_lost(self, exc: Exception | None) -> None:
        self._emulator.closed(self)
        if self._handle is None:
            return
        self._emulator.handles.release(self._handle)
        controller = self._emulator.controller
        if not self._reset_by_us and (exc is not None or controller.settings.latch_orderly_close):
            controller.error_code = LOST_CONNECTION

    def reset(self) -> None:
        """Close the connection with a TCP reset."""
        if self._transport is None or self._reset_by_us:
            return
        self._reset_by_us = True
        connected = self._transport.get_extra_info("socket")
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET_ON_CLOSE)
        self._transport.abort()

    def _replies(self, handle: str) -> list[str]:
        replies = []
        while not self._reset_by_us:
            try:
                command = self._framing.next_command()
            except LookupError:
                break
            if command is None:
                controller = self._emulator.controller
                controller.error_code = controller.settings.overlong_error
                replies.append("?")
            else:
                replies.append(self._emulator.interpreter.reply(command, handle))
        return replies


class EmulatorServer:
    """An emulated controller in a thread of this process, for tests.

    Use as a context manager; inside, `host` and `port` tell where it listens.

    Parameters
    ----------
    controller
        What the clients talk to; reach into it with `call` only.
    clock
        A `SteppedClock` (moved by `step`) or a `ScaledClock`.
    """

    def __init__(
        self, controller: Controller, clock: Clock, host: str = "127.0.0.1", port: int = 0
    ) -> None:
        self.controller = controller
        self.clock = clock
        self.host = host
        self.port = port
        self._loop = asyncio.new_event_loop()
        self._emulator = Emulator(controller, clock)
        self._thread = threading.Thread(target=self._loop.run_forever, name="emulator")

    def __enter__(self) -> Self:
        self._thread.start()
        try:
            asyncio.run_coroutine_threadsafe(self._emulator.start(self.host, self.port), self._loop).result()
        except BaseException:
            self._end()
            raise
        self.host, self.port = self._emulator.host, self._emulator.port
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        try:
            asyncio.run_coroutine_threadsafe(self._emulator.stop(), self._loop).result()
        finally:
            self._end()

    def call(self, function: Callable[[], T]) -> T:
        """Run `function` between two commands, in the server's thread, and return its result."""

        async def run() -> T:
            return function()

        return asyncio.run_coroutine_threadsafe(run(), self._loop).result()

    def step(self, samples: int) -> None:
        """Let `samples` samples pass; only with a `SteppedClock`."""
        clock = self.clock
        if not isinstance(clock, SteppedClock):
            raise TypeError("step: the emulator does not run on a SteppedClock")

        def step() -> None:
            clock.step(samples * self.controller.sample_period_s)
            self._emulator.catch_up()

        self.call(step)

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
