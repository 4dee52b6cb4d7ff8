"""What a worker is told: the file `job.json` in the folder of its run, beside the plan and the machine."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ibfctl.errors import InputError
from ibfctl.files import atomic_path
from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.runs.emulator import EmulatedController
from ibfctl.runs.journal import Journal
from ibfctl.runs.places import JOB, MACHINE, PLAN, journal_path, run_folder
from ibfctl.runs.states import RunState

_READ_ONLY = 0o444


class Address(BaseModel):
    """Where a controller listens that takes the place of the machine's own."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    host: str
    port: Annotated[int, Field(ge=1, le=65535)]


class Job(BaseModel):
    """One run.

    Attributes
    ----------
    run
        Id of the run, the name of its folder.
    operator, key
        Who started it, and the id of the key with which.
    simulated
        Whether its controller is an emulated one.
    speed
        Seconds of that controller per second of the host.
    address
        Where that controller listens.
    resume_at
        Where to go on, in samples of the plan; None from the start.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    run: str
    operator: str = ""
    key: str | None = None
    simulated: bool = False
    speed: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    address: Address | None = None
    resume_at: Annotated[int, Field(ge=0)] | None = None

    def machine(self, folder: Path) -> MachineDescription:
        """Return the machine of the run in `folder`, as its controller is to be reached."""
        machine = read_machine(folder / MACHINE)
        if self.address is None:
            return machine
        if self.simulated:
            return EmulatedController(self.address.host, self.address.port, self.speed).in_place_of(machine)
        address = {**self.address.model_dump(), "serial": None}
        return machine.model_copy(update={"connection": machine.connection.model_copy(update=address)})


def prepare(data: Path, job: Job, plan: Path, machine: Path) -> Path:
    """Make the folder of a new run with copies that nobody changes, and note in the journal that it waits.

    Parameters
    ----------
    data
        Data folder.
    job
        The run.
    plan, machine
        Plan and machine file.

    Returns
    -------
    Path
        The folder, for `ibfctl.runs.launch.start_worker`.

    Raises
    ------
    InputError
        If the run exists already.
    """
    folder = run_folder(data, job.run)
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / JOB).exists():
        raise InputError(f"run {job.run}: exists already", "give another id")
    for source, name in ((plan, PLAN), (machine, MACHINE)):
        with atomic_path(folder / name) as partial:
            shutil.copyfile(source, partial)
            partial.chmod(_READ_ONLY)
    with Journal.open(journal_path(data)) as journal:
        told = {"state": RunState.QUEUED, "operator": job.operator, "simulated": job.simulated}
        journal.append(job.run, "state", told, job.key)
    write_job(folder, job)
    return folder


def write_job(folder: Path, job: Job) -> None:
    """Write what the next worker of a run is told."""
    with atomic_path(folder / JOB) as partial:
        partial.write_text(job.model_dump_json(), encoding="utf-8")


def read_job(folder: Path) -> Job:
    """Read what a worker is told.

    Raises
    ------
    InputError
        If the file cannot be read or holds something else.
    """
    try:
        return Job.model_validate_json((folder / JOB).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"job {folder / JOB}: cannot be read ({error.strerror})", "start the run anew") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the file"
        raise InputError(f"job {folder / JOB}: {place}: {first['msg']}", "start the run anew") from error
