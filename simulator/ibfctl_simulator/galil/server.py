"""The emulator on a TCP port: its connections, and the tick that lets time pass."""

from __future__ import annotations

import asyncio
import contextlib

from ibfctl_simulator.galil.clock import Clock, ScaledClock, SteppedClock
from ibfctl_simulator.galil.connection import Connection
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.faults import ReplyFaults

TICK_S = 0.005
MOST_SAMPLES_AT_ONCE = 65536


class Emulator:
    """A controller and its clock, listening on a TCP port of the running event loop.

    Parameters
    ----------
    controller
        What the clients talk to.
    clock
        Tells how much simulated time has passed.

    Attributes
    ----------
    faults
        What goes wrong with replies.
    """

    def __init__(self, controller: Controller, clock: Clock) -> None:
        self.controller = controller
        self.clock = clock
        self.faults = ReplyFaults()
        self.host = ""
        self.port = 0
        self._server: asyncio.Server | None = None
        self._tick: asyncio.Task[None] | None = None
        self._connections: set[Connection] = set()
        self._off_until_s = 0.0

    async def start(self, host: str, port: int) -> None:
        """Listen; `host` and `port` then tell where.

        Raises
        ------
        OSError
            If the address cannot be bound.
        """
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: Connection(self), host, port)
        self.host, self.port = self._server.sockets[0].getsockname()[:2]
        self._tick = loop.create_task(self._run_ticks())

    async def stop(self) -> None:
        """Close the port and all connections."""
        if self._tick is not None:
            self._tick.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._tick
        self.faults.clear()
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
        """Let the controller's time catch up with the clock.

        A clock that runs faster than this machine can follow slips, so that clients still get answers.
        """
        state = self.controller.state
        due = state.samples_due(self.clock.now_s())
        if due > MOST_SAMPLES_AT_ONCE and isinstance(self.clock, ScaledClock):
            self.clock.slip((due - MOST_SAMPLES_AT_ONCE) * state.sample_period_s * state.clock_scale)
            due = MOST_SAMPLES_AT_ONCE
        self.controller.advance(due)

    def proceed(self) -> None:
        """Let time pass, and clients that waited for it go on."""
        self.catch_up()
        for connection in list(self._connections):
            connection.proceed()

    def step(self, clock: SteppedClock, samples: int) -> None:
        """Let `samples` samples pass on the stepped clock of this emulator."""
        state = self.controller.state
        clock.step(samples * state.sample_period_s * state.clock_scale)
        self.proceed()

    def power_cycle(self, off_s: float) -> None:
        """Start the controller anew; for `off_s` of wall-clock time nobody can connect."""
        self._off_until_s = asyncio.get_running_loop().time() + off_s
        self.controller.power_cycle()

    @property
    def off(self) -> bool:
        """Whether the power is off."""
        return asyncio.get_running_loop().time() < self._off_until_s

    def opened(self, connection: Connection) -> None:
        """Remember a connection."""
        self._connections.add(connection)

    def closed(self, connection: Connection) -> None:
        """Forget a connection."""
        self._connections.discard(connection)

    async def _run_ticks(self) -> None:
        while True:
            await asyncio.sleep(TICK_S)
            self.proceed()
