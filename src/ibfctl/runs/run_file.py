"""The run file: what was executed, what it removed, and from which plan (docs/file-formats.md).

The file is sealed: what is planned on must be what was executed.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from ibfctl import __version__
from ibfctl.errors import InputError
from ibfctl.hdf5 import check_seal, new_file
from ibfctl.machine.description import MachineDescription
from ibfctl.planning.as_run import AsRun
from ibfctl.planning.groups import fill_plan, plan_in
from ibfctl.planning.plan import InputFile, Plan
from ibfctl.planning.sequence import PlanSequence
from ibfctl.runs.history import Interval
from ibfctl.runs.outcome import RunOutcome
from ibfctl.runs.states import RunState
from ibfctl.runs.trace import RunTrace
from ibfctl.surface.map import SurfaceMap

FORMAT = "ibfctl-run/1"
SEVERAL_FORMAT = "ibfctl-tools-run/1"
_PACKAGES = ("ibfctl", "numpy", "scipy", "h5py")
_FIGURES = ("rms_nm", "pv_nm", "max_difference_nm", "rms_difference_nm")


@dataclasses.dataclass(frozen=True)
class RunRecord:
    """What a run file tells beside the plan and its removal.

    Attributes
    ----------
    machine
        As it was when the plan was run.
    executed
        Parts of the plan that were executed with the gate open, in samples since its begin.
    uncertainty_samples
        By how much the end of the last part may be later.
    trace
        Where the stages were while the gate was open; None where it never was.
    outcome
        Proof that all was executed; None where it was not.
    state, reason
        How the run ended, and why.
    run, operator, simulated
        Its id, who started it, and whether the controller was an emulated one.
    """

    machine: MachineDescription
    executed: tuple[Interval, ...]
    uncertainty_samples: int = 0
    trace: RunTrace | None = None
    outcome: RunOutcome | None = None
    state: str = RunState.COMPLETED
    reason: str = ""
    run: str = ""
    operator: str = ""
    simulated: bool = True


@dataclasses.dataclass(frozen=True)
class Remainder:
    """What is needed of a run file to plan what is left.

    Attributes
    ----------
    plan
        What was run.
    removal_nm : (ny, nx) float64
        What was removed.
    seam
        Where in the plan the run has to go on, in samples since its begin.
    uncertainty_samples
        By how much that may be later.
    """

    plan: Plan
    removal_nm: NDArray[np.float64]
    seam: int
    uncertainty_samples: int


def write_run(path: Path, plan: Plan, plan_file: InputFile, record: RunRecord, as_run: AsRun | None) -> None:
    """Write a run file, completely or not at all.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    with new_file(path, sealed=True) as file:
        _fill_head(file, FORMAT, {"plan": plan_file, **plan.inputs})
        for name in ("run", "reason", "operator", "simulated"):
            file.attrs[name] = getattr(record, name)
        file.attrs["state"] = str(record.state)  # HDF5 knows no enumerations of texts
        file.attrs["machine"] = record.machine.model_dump_json()
        file.attrs["versions"] = json.dumps({name: metadata.version(name) for name in _PACKAGES})
        fill_plan(file.create_group("plan"), plan)
        intervals = np.array(record.executed, dtype=np.int64).reshape(-1, 2)
        file.create_dataset("executed/plan_samples", data=intervals)
        file["executed"].attrs["uncertainty_samples"] = record.uncertainty_samples
        if record.outcome is not None:
            _fill_outcome(file.create_group("outcome"), record.outcome)
        if record.trace is not None:
            _fill_trace(file.create_group("trace"), record.trace, plan)
        if as_run is not None and plan.surface is not None:
            _fill_as_run(file, plan.surface, as_run)


def _fill_outcome(group: h5py.Group, outcome: RunOutcome) -> None:
    for name, value in dataclasses.asdict(outcome).items():
        if isinstance(value, dict):
            group.create_group(name).attrs.update(value)
        else:
            group.attrs[name] = value


def _fill_trace(group: h5py.Group, trace: RunTrace, plan: Plan) -> None:
    group.attrs["sample_period_s"] = trace.sample_period_s
    _table(group, "sample", trace.sample)
    _table(group, "gate_open", trace.gate_open)
    for letter, counts in trace.position_counts.items():
        axis = group.create_group(letter)
        axis.attrs["counts_per_mm"] = plan.program.axes[letter].counts_per_mm
        _table(axis, "position_counts", counts)


def write_tools_run(
    path: Path, sequence: PlanSequence, plan_file: InputFile, tools: Sequence[Mapping[str, object]], as_run: AsRun
) -> None:
    """Write what several tools have left together; `tools` says of each where its own run file is."""
    with new_file(path, sealed=True) as file:
        _fill_head(file, SEVERAL_FORMAT, {"plan": plan_file, **sequence.inputs})
        file.attrs["tools"] = json.dumps(list(tools))
        _fill_as_run(file, sequence.surface, as_run)


def _fill_head(file: h5py.File, form: str, inputs: Mapping[str, InputFile]) -> None:
    file.attrs["format"] = form
    file.attrs["version"] = __version__
    file.attrs["created"] = datetime.now(UTC).isoformat(timespec="seconds")
    file.attrs["inputs"] = json.dumps({role: dataclasses.asdict(item) for role, item in inputs.items()})


def _fill_as_run(file: h5py.File, surface: SurfaceMap, as_run: AsRun) -> None:
    group = file.create_group("as_run")
    group.attrs.update(pixel_mm=surface.pixel_mm, x0_mm=surface.x0_mm, y0_mm=surface.y0_mm)
    group.attrs.update({name: getattr(as_run, name) for name in _FIGURES})
    _table(group, "removal_nm", as_run.removal_nm)
    _table(group, "residual_nm", as_run.residual_nm)


def read_as_run(path: Path) -> AsRun | None:
    """Read what a run has removed; None where its plan had no map.

    Raises
    ------
    InputError
        If the file is no run file, or was changed since it was written.
    """
    with _readable(path) as file:
        if file.attrs.get("format") not in (FORMAT, SEVERAL_FORMAT):
            raise InputError(f"run file {path}: not a run of this version", "run the plan again")
        if "as_run" not in file:
            return None
        group = file["as_run"]
        figures = {name: float(group.attrs[name]) for name in _FIGURES}
        return AsRun(group["removal_nm"][:], group["residual_nm"][:], **figures)


def completed_one_tool(path: Path) -> bool:
    """Return whether a run file is of one tool, whose plan was executed to its end.

    Raises
    ------
    InputError
        If the file is no run file, or was changed since it was written.
    """
    with _readable(path) as file:
        return bool(file.attrs.get("format") == FORMAT and file.attrs["state"] == RunState.COMPLETED)


def read_remainder(path: Path) -> Remainder:
    """Read what a run has left of its plan.

    Raises
    ------
    InputError
        If the file is no run file of one tool, its plan had no map, or it was changed since it was written.
    """
    with _readable(path) as file:
        if file.attrs.get("format") != FORMAT:
            raise InputError(
                f"run file {path}: not a run of one tool",
                "give the run.h5 of a run; of several tools, the run.tool<n>.h5 of the one that was interrupted",
            )
        plan = plan_in(file["plan"])
        if plan.surface is None:
            raise InputError(f"run file {path}: its plan has no map", "plan the part that is left by hand")
        intervals = file["executed/plan_samples"][:]
        removal_nm = file["as_run/removal_nm"][:] if "as_run" in file else np.zeros(plan.surface.height_nm.shape)
        uncertainty = int(file["executed"].attrs["uncertainty_samples"])
    return Remainder(plan, removal_nm, int(intervals[-1, 1]) if intervals.size else 0, uncertainty)


@contextlib.contextmanager
def _readable(path: Path) -> Iterator[h5py.File]:
    try:
        check_seal(path)
        with h5py.File(path) as file:
            yield file
    except (OSError, KeyError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"run file {path}: cannot be read ({reason})", "give a run.h5 as its run has left it"
        ) from error


def _table(group: h5py.Group, name: str, values: object) -> None:
    group.create_dataset(name, data=values, compression="gzip", compression_opts=1, shuffle=True)
