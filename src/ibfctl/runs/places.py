"""Where runs keep things: the data folder, the folder of one run, the locks of machines."""

from __future__ import annotations

from pathlib import Path

JOB, PLAN, MACHINE = "job.json", "plan.h5", "machine.toml"
CONTROL, LOCK, STATUS, LOG = "control", "worker.lock", "status.json", "worker.log"
EMULATOR, EMULATOR_LOCK, EMULATOR_LOG = "emulator.json", "emulator.lock", "emulator.log"
RUN, SIDE = "run.h5", "journal.side.jsonl"
SERVICE_LOCK = "service.lock"


def run_folder(data: Path, run: str) -> Path:
    """Return the folder of a run."""
    return data / "runs" / run


def journal_path(data: Path) -> Path:
    """Return the journal of a data folder."""
    return data / "journal.db"


def journal_beside(folder: Path) -> Path:
    """Return the journal that belongs to a run's folder."""
    return journal_path(folder.parent.parent)
