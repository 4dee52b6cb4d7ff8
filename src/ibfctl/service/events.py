"""What happens, for many listeners: the journal's events with replay, and the newest sample of every run.

One reader looks at journal and status files; listeners are told that something is new and take it from memory. There is
no queue for each of them: one that is slow finds the newest sample of a run and never the older ones, and catches up on
events from the journal. None of them can slow the reader, the service or a run.
"""

from __future__ import annotations

import asyncio
import itertools
import json
from collections import deque
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from typing import Any

from ibfctl.runs.journal import Event, Journal

KEEP_ALIVE_S = 10.0
PHASES, PHASE_S = 10, 8e-3
"""Listeners take turns: all at once, fifty of them would hold every request up for as long as they need together."""
UNSHOWN = ("wire",)  # exchanges with the controller are many, and for programs alone
_RECENT = 1000
_BATCH = 500


@dataclass(frozen=True)
class Told:
    """An event of the journal, ready to be sent."""

    id: int
    run: str | None
    frame: bytes

    @classmethod
    def of(cls, event: Event) -> Told:
        """Make it of an event that the journal has given a number."""
        shown = {"run": event.run, "at": event.wall, "key": event.key, **event.data}
        return cls(event.id, event.run, _frame(event.kind, shown, event.id))


@dataclass(frozen=True)
class Sample:
    """The newest status of a run, ready to be sent."""

    seq: int
    frame: bytes

    @classmethod
    def of(cls, status: Mapping[str, Any]) -> Sample:
        """Make the sample of a status."""
        return cls(status["seq"], _frame("telemetry", status))


class Events:
    """What listeners take from; filled by whoever reads journal and status files, in the event loop."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._floor = self.last_id = journal.last_id()
        self._recent: deque[Told] = deque()
        self._samples: dict[str, Sample] = {}
        self._changed = asyncio.Event()
        self._closed = False
        self._turns = itertools.cycle(range(PHASES))
        self.listeners = 0

    def add(self, events: list[Event], statuses: list[Mapping[str, Any]]) -> None:
        """Take what is new, and tell all listeners."""
        for event in events:
            self._recent.append(Told.of(event))
            self.last_id = event.id
        while len(self._recent) > _RECENT:
            self._floor = self._recent.popleft().id
        for status in statuses:
            self._samples[status["run"]] = Sample.of(status)
        if events or statuses:
            self._tell()

    def forget(self, run: str) -> None:
        """Forget the samples of a run that is over."""
        self._samples.pop(run, None)

    def close(self) -> None:
        """End all streams."""
        self._closed = True
        self._tell()

    async def stream(self, after: int | None, run: str | None, *, follow: bool) -> AsyncIterator[bytes]:
        """Yield frames of server-sent events.

        Parameters
        ----------
        after
            Replay the journal's events after this id first; None: begin now.
        run
            Only what concerns this run; None: everything.
        follow
            Go on with what comes, rather than end with what is there.
        """
        cursor, sent = self.last_id if after is None else after, dict[str, int]()
        later_s = PHASE_S * next(self._turns) if self.listeners else 0.0
        self.listeners += 1
        try:
            yield b": ibfctl\n\n"
            while True:
                changed = self._changed
                while events := await self._after(cursor):
                    cursor = events[-1].id
                    frames = b"".join(event.frame for event in events if run in (None, event.run))
                    if frames:
                        yield frames
                sent = {name: seq for name, seq in sent.items() if name in self._samples}
                for name, sample in list(self._samples.items()):
                    if run in (None, name) and sent.get(name) != sample.seq:
                        sent[name] = sample.seq
                        yield sample.frame
                if not follow or self._closed:
                    return
                try:
                    await asyncio.wait_for(changed.wait(), KEEP_ALIVE_S)
                    await asyncio.sleep(later_s)
                except TimeoutError:
                    yield b": nothing new\n\n"
        finally:
            self.listeners -= 1

    async def _after(self, cursor: int) -> list[Told]:
        """Return events after an id, not all of them where there are many."""
        if cursor >= self.last_id:
            return []
        if cursor >= self._floor:
            return [event for event in self._recent if event.id > cursor]
        events = await asyncio.to_thread(self._journal.events, cursor, without=UNSHOWN, limit=_BATCH)
        return [Told.of(event) for event in events]

    def _tell(self) -> None:
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()


def _frame(kind: str, data: Mapping[str, Any], identity: int | None = None) -> bytes:
    place = "" if identity is None else f"id: {identity}\n"
    return f"{place}event: {kind}\ndata: {json.dumps(data)}\n\n".encode()
