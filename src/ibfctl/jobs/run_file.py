"""The run file: what was executed, what it removed, and from which plan (docs/file-formats.md)."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

import h5py

from ibfctl import __version__
from ibfctl.errors import InputError
from ibfctl.hdf5 import new_file
from ibfctl.planning.as_run import AsRun
from ibfctl.planning.plan import InputFile, Plan
from ibfctl.planning.sequence import PlanSequence
from ibfctl.runs.outcome import RunOutcome
from ibfctl.runs.trace import RunTrace
from ibfctl.surface.map import SurfaceMap

FORMAT = "ibfctl-run/1"
SEVERAL_FORMAT = "ibfctl-tools-run/1"
_FIGURES = ("rms_nm", "pv_nm", "max_difference_nm", "rms_difference_nm")


def write_run(
    path: Path, plan: Plan, plan_file: InputFile, outcome: RunOutcome, trace: RunTrace, as_run: AsRun | None
) -> None:
    """Write a run file, completely or not at all."""
    with new_file(path) as file:
        _fill_head(file, FORMAT, {"plan": plan_file, **plan.inputs})
        group = file.create_group("outcome")
        for name, value in dataclasses.asdict(outcome).items():
            if isinstance(value, dict):
                group.create_group(name).attrs.update(value)
            else:
                group.attrs[name] = value
        group = file.create_group("trace")
        group.attrs["sample_period_s"] = trace.sample_period_s
        _table(group, "sample", trace.sample)
        _table(group, "gate_open", trace.gate_open)
        for letter, counts in trace.position_counts.items():
            axis = group.create_group(letter)
            axis.attrs["counts_per_mm"] = plan.program.axes[letter].counts_per_mm
            _table(axis, "position_counts", counts)
        if as_run is not None and plan.surface is not None:
            _fill_as_run(file, plan.surface, as_run)


def write_tools_run(
    path: Path, sequence: PlanSequence, plan_file: InputFile, tools: Sequence[Mapping[str, object]], as_run: AsRun
) -> None:
    """Write what several tools have left together; `tools` says of each where its own run file is."""
    with new_file(path) as file:
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
        If the file is no run file.
    """
    try:
        with h5py.File(path) as file:
            if file.attrs.get("format") not in (FORMAT, SEVERAL_FORMAT):
                raise InputError(f"run file {path}: not a run of this version", "run the plan again")
            if "as_run" not in file:
                return None
            group = file["as_run"]
            figures = {name: float(group.attrs[name]) for name in _FIGURES}
            return AsRun(group["removal_nm"][:], group["residual_nm"][:], **figures)
    except (OSError, KeyError) as error:
        raise InputError(f"run file {path}: cannot be read ({error})", "run the plan again") from error


def _table(group: h5py.Group, name: str, values: object) -> None:
    group.create_dataset(name, data=values, compression="gzip", compression_opts=1, shuffle=True)
