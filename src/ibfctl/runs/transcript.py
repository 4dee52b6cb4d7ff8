"""The bytes that a run has sent, made again from its journal and its plan; every digest is checked."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ibfctl.errors import RunError
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import PvtProgram
from ibfctl.runs.job import read_job
from ibfctl.runs.journal import Event, Journal
from ibfctl.runs.places import journal_beside
from ibfctl.runs.seam import ramp_down, run_in
from ibfctl.runs.tools import part_of

_BATCH = re.compile(r"segments (\d+) to (\d+), (\d+) lines, sha256 ([0-9a-f]{64})")
_BATCHES_PER_RAMP = 16


def transcript(folder: Path) -> dict[str, bytes]:
    """Return what the run in `folder` has sent on every handle, as the journal and the plan tell.

    Raises
    ------
    RunError
        If the plan does not give the bytes of which the journal holds the digest.
    """
    machine = read_job(folder).machine(folder)
    with Journal.open(journal_beside(folder)) as journal:
        plans = part_of(folder, 1).plans
        legs, tools = (journal.events(run=folder.name, kind=kind) for kind in ("leg", "tool"))
        exchanges = list(journal.wire(folder.name))
    begun = [event for event in legs if "first_plan_sample" in event.data and "end" not in event.data]
    of = [plans[sum(tool.id < event.id for tool in tools)].program for event in begun]
    return replay(exchanges, [_Sent.of_leg(*leg, machine) for leg in zip(begun, of, strict=True)])


def replay(exchanges: Iterable[Sequence[Any]], legs: Sequence[_Sent]) -> dict[str, bytes]:
    """Return the bytes of every handle.

    Parameters
    ----------
    exchanges
        Handle, sent, reply and monotonic time of each, in their order.
    legs
        What was streamed, in the order in which it was.
    """
    sent: dict[str, list[bytes]] = {}
    for handle, text, _, at_s in exchanges:
        batch = _BATCH.fullmatch(text)
        parts = sent.setdefault(handle, [])
        if batch is not None:
            streamed = [leg for leg in legs if leg.recorded_s <= at_s]
            if not streamed:
                raise RunError("segments were sent before any leg was recorded", "the journal was changed")
            parts.append(streamed[-1].lines(int(batch[1]), int(batch[2]) + 1, batch[4]))
        elif text:
            parts.append(f"{text}\r".encode("ascii"))
    return {handle: b"".join(parts) for handle, parts in sent.items()}


@dataclass
class _Sent:
    """The program of a leg, and where in it a ramp to rest can have taken the place of the rest."""

    recorded_s: float
    program: PvtProgram
    machine: MachineDescription
    batches: list[int] = field(default_factory=list)

    @classmethod
    def of_leg(cls, event: Event, plan: PvtProgram, machine: MachineDescription) -> _Sent:
        """Make it again as the run did."""
        if not event.data["open_at"]:
            return cls(event.monotonic_s, plan, machine)
        return cls(event.monotonic_s, run_in(plan, event.data["first_plan_sample"], machine).program, machine)

    def lines(self, first: int, last: int, digest: str) -> bytes:
        """Return the lines of segments `first` to `last` (exclusive) that have this digest."""
        self.batches.append(first)
        data = pvt_lines(self.program, first, last)
        if _is(data, digest):
            return data
        # A pause turns to rest behind what was sent: at the begin of a batch.
        for turned in reversed(self.batches[-_BATCHES_PER_RAMP:]):
            program = ramp_down(self.program, turned, self.machine).program
            data = pvt_lines(program, first, last)
            if _is(data, digest):
                self.program = program
                return data
        raise RunError(
            f"segments {first} to {last - 1}: the plan does not give what was sent (sha256 {digest[:12]}...)",
            "the plan, the machine file or the journal was changed",
        )


def _is(data: bytes, digest: str) -> bool:
    return hashlib.sha256(data).hexdigest() == digest


def pvt_lines(program: PvtProgram, first: int, last: int) -> bytes:
    """Return the lines of segments `first` to `last` (exclusive) as a Galil controller is sent them."""
    rows: Mapping[str, list[tuple[int, int]]] = {
        letter: list(
            zip(
                program.axes[letter].increment_counts[first:last].tolist(),
                program.axes[letter].end_velocity_counts_s[first:last].tolist(),
                strict=True,
            )
        )
        for letter in sorted(program.axes)
    }
    times = program.time_samples[first:last].tolist()
    return b"".join(
        f"PV{letter}={rows[letter][row][0]},{rows[letter][row][1]},{time}\r".encode("ascii")
        for row, time in enumerate(times)
        for letter in rows
    )
