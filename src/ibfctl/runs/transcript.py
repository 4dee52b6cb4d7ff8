"""The bytes that a run has sent, made again from its journal and its plan; every digest is checked."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ibfctl.errors import RunError
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import MotionProgram, PvtProgram
from ibfctl.planning.file import read_plan
from ibfctl.runs import seam
from ibfctl.runs.job import read_job
from ibfctl.runs.journal import Event, Journal
from ibfctl.runs.leg import Leg
from ibfctl.runs.places import PLAN, journal_beside

_BATCH = re.compile(r"segments (\d+) to (\d+), (\d+) lines, sha256 ([0-9a-f]{64})")


def transcript(folder: Path) -> dict[str, bytes]:
    """Return what the run in `folder` has sent on every handle, as the journal and the plan tell.

    Raises
    ------
    RunError
        If the plan does not give the bytes of which the journal holds the digest.
    """
    plan, machine = read_plan(folder / PLAN), read_job(folder).machine(folder)
    with Journal.open(journal_beside(folder)) as journal:
        legs = journal.events(run=folder.name, kind="leg")
        exchanges = list(journal.wire(folder.name))
    return replay(exchanges, leg_programs(legs, plan.program, machine))


def leg_programs(
    events: Iterable[Event], plan: PvtProgram, machine: MachineDescription
) -> list[tuple[float, list[MotionProgram]]]:
    """Return for every leg when it was recorded, and what it can have streamed: its program, and that with a ramp."""
    found: list[tuple[float, list[MotionProgram]]] = []
    for event in events:
        data = event.data
        if "first_plan_sample" in data:
            leg = Leg(plan) if data["open_at"] == 0 else Leg.resumed(plan, data["first_plan_sample"], machine)
            found.append((event.monotonic_s, [leg.program]))
        elif data.get("leave_at") is not None:
            programs = found[-1][1]
            assert isinstance(programs[0], PvtProgram)  # no other can pause
            programs.append(seam.ramp_down(programs[0], data["leave_at"], machine).program)
    return found


def replay(exchanges: Iterable[Sequence[Any]], legs: Sequence[tuple[float, list[MotionProgram]]]) -> dict[str, bytes]:
    """Return the bytes of every handle.

    Parameters
    ----------
    exchanges
        Handle, sent, reply and monotonic time of each, in their order.
    legs
        Of `leg_programs`.
    """
    sent: dict[str, bytes] = {}
    for handle, text, _, at_s in exchanges:
        data = sent.setdefault(handle, b"")
        batch = _BATCH.fullmatch(text)
        if batch is not None:
            programs = [programs for begun, programs in legs if begun <= at_s]
            data += _lines(batch, programs[-1] if programs else [])
        elif text:
            data += f"{text}\r".encode("ascii")
        sent[handle] = data
    return sent


def _lines(batch: re.Match[str], programs: Sequence[MotionProgram]) -> bytes:
    first, last, digest = int(batch[1]), int(batch[2]) + 1, batch[4]
    for program in programs:
        data = pvt_lines(program, first, last) if isinstance(program, PvtProgram) else b""
        if hashlib.sha256(data).hexdigest() == digest:
            return data
    raise RunError(
        f"segments {first} to {last - 1}: the plan does not give what was sent (sha256 {digest[:12]}...)",
        "the plan, the machine file or the journal was changed",
    )


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
