"""Child processes of the service: one line of JSON goes in, JSON lines with events come out."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Callable
from typing import Any

Event = dict[str, Any]
TASKS = "ibfctl.service.tasks"
_LINE_LIMIT = 1 << 20
_END_TIMEOUT_S = 20.0


class Child:
    """A module of the product running as its own process."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    @classmethod
    async def start(cls, module: str, arguments: list[str], request: Any) -> Child:
        """Start ``python -m module arguments`` and hand it its request."""
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            module,
            *arguments,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=_LINE_LIMIT,
            start_new_session=True,  # an interrupt from the keyboard is for the service, which ends its children
        )
        child = cls(process)
        await child.tell(json.dumps(request))
        return child

    async def tell(self, line: str) -> None:
        """Send one line to the child; one that is gone hears nothing."""
        assert self._process.stdin is not None  # made with a pipe
        try:
            self._process.stdin.write(f"{line}\n".encode())
            await self._process.stdin.drain()
        except (BrokenPipeError, ConnectionResetError):
            pass

    def hang_up(self) -> None:
        """Close the child's input: that cancels a plan and aborts a run."""
        assert self._process.stdin is not None  # made with a pipe
        self._process.stdin.close()

    def kill(self) -> None:
        """End a child that does not end by itself."""
        self._process.kill()

    async def last_event(self, on_progress: Callable[[Event], None]) -> Event:
        """Pass on events until the last one, ``finished`` or ``failed``, and return it once the child is gone.

        The child is ended where this is cancelled.
        """
        assert self._process.stdout is not None  # made with a pipe
        last: Event = {}
        try:
            async for line in self._process.stdout:
                event = json.loads(line)
                if event["event"] == "progress":
                    on_progress(event)
                else:
                    last = event
            await self._process.wait()
        finally:
            await self._end()
        return last or {
            "event": "failed",
            "code": "error",
            "message": f"worker process ended with code {self._process.returncode} and without a result",
            "hint": "see the service's log",
        }

    async def _end(self) -> None:
        self.hang_up()
        try:
            await asyncio.wait_for(self._process.wait(), _END_TIMEOUT_S)
        except TimeoutError:
            self._process.kill()
            await self._process.wait()
