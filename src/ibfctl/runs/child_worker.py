"""One process per run: a job comes in on standard input, JSON lines with progress and result go out.

``python -m ibfctl.runs.child_worker`` reads one line of JSON (`Job`). A further line ``abort``, the end of
standard input (a dead parent closes it) and SIGTERM abort the run. The lines that go out have an ``event``:
``progress``, ``finished`` or ``failed``; the exit code is that of the error, or 0.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ibfctl.errors import AbortedError, IbfctlError, InputError
from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.machine.program import MotionProgram
from ibfctl.planning.file import read_plan
from ibfctl.runs.drivers import connect
from ibfctl.runs.emulator import emulated_controller
from ibfctl.runs.outcome import RunOutcome, RunProgress
from ibfctl.runs.streamer import execute

Report = Callable[[Mapping[str, object]], None]


class Job(BaseModel):
    """What to run, and on what.

    Attributes
    ----------
    plan
        The plan file; it holds the program and the machine that it was planned for.
    machine
        Machine file to run with, where host or port have changed; the plan's own if not given.
    trace
        If given, an emulated controller is started for this run, and writes its trace there.
    speed
        Speed of that controller's clock.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    plan: Path
    machine: Path | None = None
    trace: Path | None = None
    speed: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0


def run_program(
    program: MotionProgram,
    machine: MachineDescription,
    report: Report,
    abort: threading.Event,
    *,
    trace: Path | None = None,
    speed: float = 1.0,
) -> RunOutcome:
    """Connect, execute and disconnect, reporting progress; the arguments are those of `Job`.

    Raises
    ------
    IbfctlError
        As `connect`, `emulated_controller` and `execute`.
    """
    with ExitStack() as resources:
        time_scale = 1.0
        if trace is not None:
            emulated = resources.enter_context(emulated_controller(trace, speed=speed))
            machine, time_scale = emulated.in_place_of(machine), emulated.time_scale
        if abort.is_set():
            raise AbortedError("run aborted before the controller was connected")
        controller: MotionController = connect(machine)
        resources.callback(controller.close)
        return execute(
            program,
            machine,
            controller,
            on_progress=lambda progress: report(_line_of(progress)),
            abort=abort,
            time_scale=time_scale,
        )


def main() -> int:
    """Serve one job; return the exit code."""
    abort = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: abort.set())
    signal.signal(signal.SIGINT, lambda *_: abort.set())
    lines = _StandardInput()
    try:
        job = _parse(lines.next() or "")
        threading.Thread(target=_watch, args=(lines, abort), name="run-commands", daemon=True).start()
        plan = read_plan(job.plan)
        machine = plan.machine if job.machine is None else read_machine(job.machine)
        outcome = run_program(plan.program, machine, _print, abort, trace=job.trace, speed=job.speed)
    except IbfctlError as error:
        _print({"event": "failed", "code": error.code, "message": error.message, "hint": error.hint})
        return error.exit_code
    _print({"event": "finished", **asdict(outcome)})
    return 0


class _StandardInput:
    """Lines from file descriptor 0, without the buffer whose lock a waiting daemon thread would hold."""

    def __init__(self) -> None:
        self._received = b""

    def next(self) -> str | None:
        """Return the next line, None at the end."""
        while b"\n" not in self._received:
            chunk = os.read(0, 4096)
            if not chunk:
                return None
            self._received += chunk
        line, self._received = self._received.split(b"\n", 1)
        return line.decode("utf-8", "replace")


def _watch(lines: _StandardInput, abort: threading.Event) -> None:
    while lines.next() not in ("abort", None):
        pass
    abort.set()


def _parse(line: str) -> Job:
    try:
        return Job.model_validate_json(line)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the line"
        hint = "give one line of JSON with plan, machine, trace and speed"
        raise InputError(f"job: {place}: {first['msg']}", hint) from error


def _line_of(progress: RunProgress) -> dict[str, object]:
    gate = "open" if progress.gate_open else "closed"
    return {
        "event": "progress",
        "segment": progress.sent,
        "executed": progress.executed,
        "total": progress.total,
        "margin_s": round(progress.margin_s, 3),
        "gate": gate,
    }


def _print(line: Mapping[str, object]) -> None:
    print(json.dumps(line), flush=True)


if __name__ == "__main__":
    sys.exit(main())
