"""From input files to a plan file: read, hash, plan, write."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

from ibfctl.errors import InputError
from ibfctl.jobs.inputs import InfluenceFile, MapFile
from ibfctl.machine.description import read_machine
from ibfctl.path.from_file import read_columns
from ibfctl.planning.file import write_plan
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import InputFile, Plan
from ibfctl.planning.planner import make_plan, schedule_nodes
from ibfctl.surface.readers.formula import GAUSSIAN_PREFIX
from ibfctl.surface.readers.long_tail import LONG_TAIL_PREFIX
from ibfctl.surface.regions import MaskFile

Report = Callable[[str, float], None]


def plan_files(
    surface: MapFile,
    influence: InfluenceFile,
    machine: Path,
    options: PlanOptions,
    output: Path,
    *,
    on_progress: Report | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> Plan:
    """Plan a job from files and write the plan to `output`.

    Raises
    ------
    InputError, LimitsError, SolverError, CancelledError
        As `make_plan` and the readers do; nothing is written then.
    """
    surface_map, tool = surface.read(), influence.read()
    inputs = {
        "map": hashed(surface.path),
        "influence": hashed(influence.spec),
        "machine": hashed(machine),
    }
    if isinstance(options.path, Path):
        inputs["path"] = hashed(options.path)
    if isinstance(options.clear_aperture, MaskFile):
        inputs["mask"] = hashed(options.clear_aperture.path)
    plan = make_plan(
        surface_map,
        tool,
        read_machine(machine),
        options,
        progress=on_progress,
        cancelled=cancelled,
        inputs=inputs,
    )
    write_plan(plan, output)
    return plan


def schedule_file(timed_nodes: Path, machine: Path, corridor_mm: float | None, output: Path) -> Plan:
    """Schedule nodes whose dwell times are given, and write the plan to `output`."""
    x_mm, y_mm, dwell_s = read_columns(timed_nodes, ("x_mm", "y_mm", "dwell_s"))
    inputs = {"nodes": hashed(timed_nodes), "machine": hashed(machine)}
    plan = schedule_nodes(x_mm, y_mm, dwell_s, read_machine(machine), corridor_mm=corridor_mm, inputs=inputs)
    write_plan(plan, output)
    return plan


def hashed(spec: str | Path) -> InputFile:
    """Return an input's name and SHA-256: of the file's bytes, or of the text of a formula."""
    if str(spec).startswith(GAUSSIAN_PREFIX):
        return InputFile(str(spec), hashlib.sha256(str(spec).encode()).hexdigest())
    path = Path(str(spec).removeprefix(LONG_TAIL_PREFIX))
    try:
        with path.open("rb") as stream:
            return InputFile(path.name, hashlib.file_digest(stream, "sha256").hexdigest())
    except OSError as error:
        raise InputError(f"{spec}: cannot be read ({error.strerror})", "check the path") from error
