"""After an interruption: make the machine safe, then find out which part of the plan was executed.

The controller's stamps tell it to the sample, as long as the controller has had power; otherwise the journal and the
last status of the worker tell it to within the guard's patience. Nothing is claimed that is not known.
"""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from ibfctl.errors import ControllerError, RunError
from ibfctl.machine.controller import MotionController, Stamps
from ibfctl.machine.description import MachineDescription
from ibfctl.runs import drivers, status
from ibfctl.runs.adoption import last_state
from ibfctl.runs.history import History, Interval, LegRecord, history
from ibfctl.runs.job import Job, read_job, write_job
from ibfctl.runs.journal import Journal
from ibfctl.runs.launch import start_worker
from ibfctl.runs.leg import Leg
from ibfctl.runs.lock import MachineLock, take
from ibfctl.runs.places import LOCK, SIDE, journal_beside
from ibfctl.runs.recorder import absorb
from ibfctl.runs.records import record_run
from ibfctl.runs.states import RunState
from ibfctl.runs.tools import Part, part_of, tool_under_way

RESUMABLE_SAMPLES = 20
"""How uncertain a seam may be: the dose of so few samples is less than what a resume may cost."""
STATUS_AGE_S = 0.25
"""How old, at most, the worker's last status was when it died."""
CLOCK_SLACK_S = 0.05

Connect = Callable[[MachineDescription], MotionController]


@dataclass(frozen=True)
class Recovered:
    """What is known of a run that has no worker.

    Attributes
    ----------
    executed
        Parts of the plan that were executed with the gate open, in samples from its begin.
    uncertainty_samples
        By how much the end of the last part may be later; 0 where the controller has stamped it.
    seam
        Where in the plan the run can be resumed, or its rest be planned from.
    can_resume, why_not
        Whether it can be resumed at the seam, and what is in the way.
    hint
        What the operator can do about it.
    begun_samples
        The controller's stamp of the begin of the last motion; None where there is none.
    """

    executed: tuple[Interval, ...]
    uncertainty_samples: int
    seam: int
    can_resume: bool
    why_not: str = ""
    hint: str = ""
    begun_samples: int | None = None


def recover(folder: Path, connect: Connect = drivers.connect) -> Recovered:
    """Close the gate, bring the axes to rest, and find out what the run in `folder` has executed.

    The finding is noted in the journal, which `ibfctl.runs.history` reads, and `run.h5` is written.

    Parameters
    ----------
    folder
        Of a run without a worker.
    connect
        Connects to the machine.

    Raises
    ------
    RunError
        If its worker lives, or the machine is in use.
    ControllerError
        If the controller cannot be reached, or the gate cannot be closed.
    """
    lock = take(folder / LOCK, f"recovery by process {os.getpid()}")
    if lock is None:
        raise RunError(f"run {folder.name} has a worker: it is not interrupted", "wait for its end, or stop it")
    try:
        found = recover_own(folder, connect)
        told = {"hint": found.hint or f"`ibfctl runs resume {folder.name}` goes on where it was"}
        interrupted = (status.read(folder) or {}).get("state") == RunState.INTERRUPTED
        status.amend(folder, gate="closed", **(told if interrupted else {}))
    finally:
        os.close(lock)
    return found


def recover_own(folder: Path, connect: Connect = drivers.connect) -> Recovered:
    """Recover a run of which the caller holds the lock, as its worker does; all else as `recover`."""
    job = read_job(folder)
    machine = job.machine(folder)
    with MachineLock(machine, f"recovery of run {folder.name}"), Journal.open(journal_beside(folder)) as journal:
        absorb(journal, folder / SIDE)
        controller = connect(machine)
        try:
            part = part_of(folder, tool_under_way(journal, folder.name))
            found = _Case(folder, part, machine, job, controller, journal).solve()
        finally:
            controller.close()
        journal.append(folder.name, "recovered", asdict(found))
    record_run(folder)
    return found


def resume(folder: Path, found: Recovered) -> subprocess.Popen[bytes]:
    """Start a new worker that goes on at the seam; returns as `start_worker`.

    Raises
    ------
    RunError
        If the run cannot be resumed.
    """
    if not found.can_resume:
        raise RunError(f"run {folder.name} cannot be resumed: {found.why_not}", found.hint)
    write_job(folder, read_job(folder).model_copy(update={"resume_at": found.seam}))
    return start_worker(folder)


class _Case:
    """One interrupted run and the machine that it has left."""

    def __init__(
        self,
        folder: Path,
        part: Part,
        machine: MachineDescription,
        job: Job,
        controller: MotionController,
        journal: Journal,
    ) -> None:
        self._folder = folder
        self._part = part
        self._plan = part.plan
        self._machine = machine
        self._job = job
        self._controller = controller
        self._journal = journal
        self._total = part.total_samples

    def solve(self) -> Recovered:
        """Make safe, ask, and conclude."""
        self._controller.close_gate()
        self._controller.stop()
        self._controller.stop_guard()
        known = history(self._journal, self._folder.name)
        executed, uncertainty, stamps = self._executed(known)
        seam = executed[-1][1] if executed else known.seam
        why_not, hint = self._obstacle(seam, uncertainty, reset=stamps is None)
        return Recovered(
            tuple(executed), uncertainty, seam, not why_not, why_not, hint, stamps.begun if stamps else None
        )

    def _executed(self, known: History) -> tuple[list[Interval], int, Stamps | None]:
        executed, uncertainty, leg = list(known.executed), known.uncertainty_samples, known.last_leg
        stamps = self._stamps()
        if leg is None or (leg.ended and not uncertainty):
            return executed, uncertainty, stamps
        if stamps is not None and self._belong(stamps, leg, known):
            before = executed[:-1] if leg.ended else executed
            return before + self._stamped(leg, stamps), 0, stamps
        if leg.ended or stamps is not None or not (leg.armed or leg.open_at):
            return executed, uncertainty, stamps
        interval, uncertainty = self._last_seen(leg)
        return executed + interval, uncertainty, None

    def _stamps(self) -> Stamps | None:
        """Read the stamps; None where the controller has lost them with its power."""
        try:
            return self._controller.stamps()
        except ControllerError:
            return None

    def _belong(self, stamps: Stamps, leg: LegRecord, known: History) -> bool:
        """Whether stamps are those of a leg, and not of a motion before it."""
        if stamps.begun is None or stamps.begun in known.known_begins:
            return False
        if leg.begun_samples is not None:
            return stamps.begun == leg.begun_samples
        if leg.armed:
            return True
        ago_s = (stamps.now - stamps.begun) * self._plan.program.sample_period_s / self._job.speed
        return time.monotonic() - ago_s > leg.recorded.monotonic_s - CLOCK_SLACK_S

    def _stamped(self, record: LegRecord, stamps: Stamps) -> list[Interval]:
        if stamps.begun is None or stamps.opened is None:
            return []
        leg = self._leg(record)
        closed = self._total if stamps.closed is None else stamps.closed - stamps.begun + leg.shift_samples
        opened = stamps.opened - stamps.begun + leg.shift_samples
        return [(opened, max(opened, min(closed, self._total)))]

    def _last_seen(self, record: LegRecord) -> tuple[list[Interval], int]:
        """Say what the worker has last said, and by how much the guard may have closed the gate later."""
        place = (status.read(self._folder) or {}).get("place") or {}
        progress = self._journal.last(self._folder.name, "progress")
        samples = [place.get("plan_sample", 0)]
        if progress is not None and progress.id > record.recorded.id:
            samples.append((progress.data.get("place") or {}).get("plan_sample", 0))
        seen = min(max(samples), self._total)
        seen = max(seen, record.first_plan_sample)
        patience_s = (self._machine.beam_gate.guard_patience_s + STATUS_AGE_S) * self._job.speed
        later = round(patience_s / self._plan.program.sample_period_s)
        return [(record.first_plan_sample, seen)] * (seen > record.first_plan_sample), min(later, self._total - seen)

    def _leg(self, record: LegRecord) -> Leg:
        program = self._plan.program
        return Leg.resumed(program, record.first_plan_sample, self._machine) if record.open_at else Leg(program)

    def _obstacle(self, seam: int, uncertainty: int, *, reset: bool) -> tuple[str, str]:
        """Return what is in the way of a resume, and what to do; nothing where it can be resumed."""
        state = last_state(self._journal, self._folder.name)
        homed = self._controller.homed()
        if self._controller.latched():
            return "an emergency stop is latched on the controller", "make the machine safe, switch it off and on"
        if seam >= self._total and self._part.is_last:
            return "the plan was executed to its end", "measure the part"
        if seam < self._total and not all(homed.values()):  # between two tools the machine is referenced anyway
            lost = ", ".join(sorted(letter for letter, known in homed.items() if not known))
            return (
                f"axis {lost} is not homed since the controller has had power",
                "home the machine, then recover again",
            )
        if uncertainty > RESUMABLE_SAMPLES:
            return (
                f"the gate may have been open for {uncertainty * self._plan.program.sample_period_s:.2f} s longer "
                f"than is known" + (": the controller was reset" if reset else ""),
                "measure the part, or re-plan what is left with `ibfctl replan`",
            )
        if state not in (RunState.INTERRUPTED, RunState.PAUSED):
            return f"the run is {state}", "re-plan what is left with `ibfctl replan`"
        return "", ""
