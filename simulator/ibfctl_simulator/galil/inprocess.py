"""The emulator in a thread of a test's own process."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self, TypeVar

from ibfctl_simulator.galil.clock import Clock, SteppedClock
from ibfctl_simulator.galil.control import apply_command
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.server import Emulator

T = TypeVar("T")


class EmulatorServer:
    """An emulated controller that listens while its context is open.

    Inside the context `host` and `port` tell where.

    Parameters
    ----------
    controller
        What the clients talk to; while it serves, reach into it with `call` only.
    clock
        A `SteppedClock` (moved by `step`) or a `ScaledClock`.
    """

    def __init__(self, controller: Controller, clock: Clock, host: str = "127.0.0.1", port: int = 0) -> None:
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
        self.call(lambda: self._emulator.step(clock, samples))

    def fault(self, command: str) -> None:
        """Make something go wrong, as a line on the control port would.

        Raises
        ------
        ValueError
            If the line is not understood.
        """
        self.call(lambda: apply_command(self._emulator, command))

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
