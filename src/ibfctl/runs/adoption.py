"""Which runs live, and what became of those that no longer do.

A worker lives as long as the lock of its folder is held: a process id may belong to somebody else by now.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ibfctl.runs import status
from ibfctl.runs.journal import Journal
from ibfctl.runs.lock import is_held, take
from ibfctl.runs.places import JOB, LOCK, SIDE, journal_path
from ibfctl.runs.recorder import absorb
from ibfctl.runs.states import TERMINAL, RunState, check

REASON = "the worker ended without a word"


def has_worker(folder: Path) -> bool:
    """Return whether the worker of the run in `folder` lives."""
    return is_held(folder / LOCK)


def run_folders(data: Path) -> list[Path]:
    """Return the folders of all runs of a data folder, by their ids."""
    return sorted(path.parent for path in (data / "runs").glob(f"*/{JOB}"))


def living(data: Path) -> list[Path]:
    """Return the folders of all runs whose workers live."""
    return [folder for folder in run_folders(data) if has_worker(folder)]


def last_state(journal: Journal, run: str) -> RunState:
    """Return the last state of a run that the journal knows."""
    event = journal.last(run, "state")
    return RunState.QUEUED if event is None else RunState(event.data["state"])


def interrupt_orphans(data: Path) -> list[Path]:
    """Note `interrupted` for every run that was under way and has no worker; return their folders.

    What such a worker had still to say to the journal is written first. Runs that are queued are left alone: a
    worker of theirs has not begun.
    """
    interrupted = []
    with Journal.open(journal_path(data)) as journal:
        for folder in run_folders(data):
            lock = take(folder / LOCK, f"recovery by process {os.getpid()}")
            if lock is None:
                continue
            try:
                absorb(journal, folder / SIDE)
                state = last_state(journal, folder.name)
                if state in TERMINAL | {RunState.QUEUED, RunState.INTERRUPTED}:
                    continue
                check(state, RunState.INTERRUPTED)
                journal.append(folder.name, "state", {"state": RunState.INTERRUPTED, "was": state, "reason": REASON})
                # What the worker said of the gate holds no more.
                hint = f"`ibfctl runs recover {folder.name}` closes the gate and asks the controller what was executed"
                status.amend(folder, state=RunState.INTERRUPTED, reason=REASON, hint=hint, gate="unknown")
                interrupted.append(folder)
            finally:
                os.close(lock)
    return interrupted


def end_orphan(folder: Path, state: RunState, told: Mapping[str, Any]) -> None:
    """Note how a run has ended whose worker was ended from outside; one that was over stays as it is.

    Parameters
    ----------
    told
        Why: `code`, `reason` and `hint`, and what else the status is to show.
    """
    with Journal.open(journal_path(folder.parent.parent)) as journal:
        absorb(journal, folder / SIDE)
        last = last_state(journal, folder.name)
        if last not in TERMINAL:
            check(last, state)
            journal.append(folder.name, "state", {"state": state, "was": last, **told})
            status.amend(folder, state=state, **told)
