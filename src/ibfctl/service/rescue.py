"""What cannot wait is seen to: where a process does not act on an abort or an emergency stop, the service does itself.

A process that hangs still takes what is written to its pipe, so that it was told says nothing. Only its end does.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ibfctl.errors import IbfctlError
from ibfctl.runs import status
from ibfctl.runs.control import open_pipe
from ibfctl.runs.job import read_job
from ibfctl.runs.launch import WORKER
from ibfctl.runs.places import MACHINE
from ibfctl.service.children import Child, Event

HEARD_S = 1.0
"""How long whoever was told may take to end."""
LAST_S = 10.0
"""And how much longer once the controller was reached without it; a process that is only slow ends in that time.

As long again until the next attempt where it was not reached.
"""
_LOOK_S = 0.05
_ACTS = "ibfctl.service.machine_acts"
_DONE = {
    "abort": "the service itself closed the gate and stopped all motion on the controller",
    "estop": "the service itself closed the gate, stopped all motion, switched the motors off and latched that",
}


async def is_true_within(told: Callable[[], bool], patience_s: float) -> bool:
    """Return whether something becomes true in a time."""
    for _ in range(round(patience_s / _LOOK_S)):
        if told():
            return True
        await asyncio.sleep(_LOOK_S)
    return told()


async def carry_out(folder: Path, request: Mapping[str, Any], began: Callable[[Child], None] = lambda _: None) -> Event:
    """Have an act on a machine done by a process of its own; return its last event.

    Parameters
    ----------
    folder
        Of this act alone: it holds the pipe through which the act is ended, and is removed.
    request
        `ibfctl.service.machine_acts.Act`.
    began
        Is given the process.
    """
    folder.mkdir(parents=True)
    pipe = open_pipe(folder)  # what is said before the child listens waits in it
    try:
        child = await Child.start(_ACTS, [str(folder)], request)
        began(child)
        return await child.last_event(lambda progress: None)
    finally:
        os.close(pipe)
        shutil.rmtree(folder)


def request_for_run(act: str, folder: Path) -> dict[str, Any]:
    """Return the act on the machine of the run in `folder`, as its controller is to be reached.

    Raises
    ------
    InputError
        If its job cannot be read.
    """
    job = read_job(folder)
    address = None if job.address is None else job.address.model_dump()
    return {"name": act, "machine": str(folder / MACHINE), "address": address, "speed": job.speed}


async def act_without(who: str, act: str, folder: Path, request: Mapping[str, Any]) -> tuple[bool, dict[str, Any]]:
    """Reach a controller without the process that holds it.

    Returns
    -------
    bool
        Whether its gate is closed and nothing moves.
    dict
        What was done, as `code`, `message` and `hint`.
    """
    event = await carry_out(folder, {**request, "name": act})
    silent = f"{who} did not act on {'an emergency stop' if act == 'estop' else 'an abort'} within {HEARD_S:g} s"
    if event["event"] == "finished":
        hint = "see why it hung, and measure the part or plan what is left before the next run"
        return True, {"code": "silent", "message": f"{silent}: {_DONE[act]}", "hint": hint}
    hint = "switch the beam off by hand now, and use the machine's own emergency stop"
    return False, {"code": "silent", "message": f"{silent}, and {event['message']}", "hint": hint}


def kill_worker(folder: Path) -> None:
    """End the worker of the run in `folder` for good, which does not end by itself.

    Raises
    ------
    IbfctlError
        If it is not known which process that is.
    """
    number = (status.read(folder) or {}).get("worker_pid")
    try:
        command = Path(f"/proc/{int(number or 0)}/cmdline").read_bytes().split(b"\0")
    except OSError:
        command = []
    if number is None or not {WORKER.encode(), os.fsencode(folder.absolute())} <= set(command):
        raise IbfctlError(f"the worker of run {folder.name} cannot be found", "end its process by hand")
    os.kill(number, signal.SIGKILL)
