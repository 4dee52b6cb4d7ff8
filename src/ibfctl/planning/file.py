"""The plan file, `plan.h5`: one HDF5 file that a shop can open, complete enough to run and to prove.

Layout (docs/file-formats.md explains it; names are stable):

``/program/<axis letter>/increment_counts, end_velocity_counts_s, time_samples``
    (n,) int64, one row per segment; attributes of the group: `counts_per_mm` (signed), `start_mm`,
    `start_counts`, `sample_period_s`, `coordinate`.
``/path/x_mm, y_mm``
    Nodes (m + 1,).
``/dwell/x_mm, y_mm, time_s``
    Dwell points (m,) and the times that were asked for.
``/map/height_nm``
    (ny, nx); attributes `pixel_mm`, `x0_mm`, `y0_mm`.
``/influence/rate_nm_s``
    (ny, nx); attribute `pixel_mm`.
``/prediction/residual_nm, ideal_residual_nm, initial_nm, removal_nm, clear_aperture``
    (ny, nx): after the executed removal, after the ideal one, before, and the executed removal itself.
``/psd/x, y, radial/frequency_per_mm, weight, before, after``
    (k,): power spectral densities, see `ibfctl.surface.psd`; written for others, not read back.
``/`` attributes
    `format`, `version` (of ibfctl), `machine`, `options`, `certificate`, `rounds`, `trade_off`, `inputs` (names and
    SHA-256), all JSON, and `planning_time_s`. `/map`, `/influence`, `/prediction` and `/psd` are absent where only a
    schedule was made.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np
from pydantic import TypeAdapter, ValidationError

from ibfctl import __version__
from ibfctl.errors import InputError
from ibfctl.hdf5 import new_file
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import AxisProgram, PvtProgram
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import CurvePoint, DwellPlan, InputFile, Plan, Prediction, Round
from ibfctl.planning.spectra import spectra
from ibfctl.schedule.certificate import Certificate, Check
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import SurfaceMap

FORMAT = "ibfctl-plan/1"
_OPTIONS = TypeAdapter(PlanOptions)
_INPUTS = TypeAdapter(dict[str, InputFile])
_CHECKS = TypeAdapter(tuple[Check, ...])
_ROUNDS = TypeAdapter(tuple[Round, ...])
_CURVE = TypeAdapter(tuple[CurvePoint, ...])
_COMPRESSED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def write_plan(plan: Plan, path: Path) -> None:
    """Write `plan` to `path`: a new file appears whole or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with new_file(path) as file:
        _fill(file, plan)


def _fill(file: h5py.File, plan: Plan) -> None:
    file.attrs["format"] = FORMAT
    file.attrs["version"] = __version__
    file.attrs["machine"] = plan.machine.model_dump_json()
    file.attrs["options"] = _OPTIONS.dump_json(plan.options).decode()
    file.attrs["certificate"] = _CHECKS.dump_json(plan.certificate.checks).decode()
    file.attrs["rounds"] = _ROUNDS.dump_json(plan.rounds).decode()
    file.attrs["trade_off"] = _CURVE.dump_json(plan.trade_off).decode()
    file.attrs["inputs"] = json.dumps({role: asdict(item) for role, item in plan.inputs.items()})
    file.attrs["planning_time_s"] = plan.planning_time_s
    for letter, axis in plan.program.axes.items():
        group = file.create_group(f"program/{letter}")
        group.attrs["counts_per_mm"] = axis.counts_per_mm
        group.attrs["start_mm"] = axis.start_mm
        group.attrs["start_counts"] = axis.start_counts
        group.attrs["sample_period_s"] = plan.program.sample_period_s
        group.attrs["coordinate"] = plan.machine.axes[letter].coordinate  # type: ignore[index]
        for name, values in (
            ("increment_counts", axis.increment_counts),
            ("end_velocity_counts_s", axis.end_velocity_counts_s),
            ("time_samples", plan.program.time_samples),
        ):
            group.create_dataset(name, data=values.astype(np.int64), **_COMPRESSED)
    for name, values_mm in (("x_mm", plan.path.x_mm), ("y_mm", plan.path.y_mm)):
        file.create_dataset(f"path/{name}", data=values_mm, **_COMPRESSED)
    for name in ("x_mm", "y_mm", "time_s"):
        file.create_dataset(f"dwell/{name}", data=getattr(plan.dwell, name), **_COMPRESSED)
    if plan.surface is not None:
        dataset = file.create_dataset("map/height_nm", data=plan.surface.height_nm, **_COMPRESSED)
        for name in ("pixel_mm", "x0_mm", "y0_mm"):
            dataset.attrs[name] = getattr(plan.surface, name)
    if plan.influence is not None:
        dataset = file.create_dataset("influence/rate_nm_s", data=plan.influence.rate_nm_s, **_COMPRESSED)
        dataset.attrs["pixel_mm"] = plan.influence.pixel_mm
    if plan.prediction is not None:
        for name, array in (
            ("residual_nm", plan.prediction.executed_residual_nm),
            ("ideal_residual_nm", plan.prediction.ideal_residual_nm),
            ("initial_nm", plan.prediction.initial_nm),
            ("removal_nm", plan.prediction.executed_removal_nm),
            ("clear_aperture", plan.prediction.clear_aperture),
        ):
            file.create_dataset(f"prediction/{name}", data=array, **_COMPRESSED)
    if plan.prediction is not None and plan.surface is not None:
        for name, change in spectra(plan.prediction, plan.surface.pixel_mm).items():
            for column, numbers in (
                ("frequency_per_mm", change.before.frequency_per_mm),
                ("weight", change.before.weight),
                ("before", change.before.density),
                ("after", change.after.density),
            ):
                file.create_dataset(f"psd/{name}/{column}", data=numbers, **_COMPRESSED)


def read_plan(path: Path) -> Plan:
    """Read a plan file.

    Raises
    ------
    InputError
        If it cannot be read, is no plan file, or is damaged.
    """
    with _readable(path) as file:
        if file.attrs.get("format") != FORMAT:
            raise InputError(f"plan file {path}: not a plan of this version", "make it anew with `ibfctl plan`")
        machine = MachineDescription.model_validate_json(file.attrs["machine"])
        return Plan(
            machine,
            _OPTIONS.validate_json(file.attrs["options"]),
            ToolPath(file["path/x_mm"][:], file["path/y_mm"][:]),
            DwellPlan(*(file[f"dwell/{name}"][:] for name in ("x_mm", "y_mm", "time_s"))),
            _program(file["program"]),
            Certificate(_CHECKS.validate_json(file.attrs["certificate"])),
            _surface(file["map/height_nm"]) if "map" in file else None,
            _influence(file["influence/rate_nm_s"]) if "influence" in file else None,
            _prediction(file["prediction"]) if "prediction" in file else None,
            _ROUNDS.validate_json(file.attrs["rounds"]),
            _INPUTS.validate_json(file.attrs["inputs"]),
            float(file.attrs["planning_time_s"]),
            _CURVE.validate_json(file.attrs.get("trade_off", "[]")),
        )


@contextlib.contextmanager
def _readable(path: Path) -> Iterator[h5py.File]:
    try:
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError, ValidationError) as error:
        if isinstance(error, InputError):
            raise
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"plan file {path}: cannot be read ({reason})", "give a plan.h5 that `ibfctl plan` or `schedule` wrote"
        ) from error


def _program(group: h5py.Group) -> PvtProgram:
    axes, coordinates = {}, {}
    for letter in sorted(group):
        attributes = group[letter].attrs
        axes[letter] = AxisProgram(
            group[letter]["increment_counts"][:],
            group[letter]["end_velocity_counts_s"][:],
            int(attributes["start_counts"]),
            float(attributes["counts_per_mm"]),
        )
        coordinates[str(attributes["coordinate"])] = letter
        time_samples = group[letter]["time_samples"][:]
        period_s = float(attributes["sample_period_s"])
    sizes = {axis.increment_counts.size for axis in axes.values()} | {
        axis.end_velocity_counts_s.size for axis in axes.values()
    }
    if sorted(coordinates) != ["x", "y"] or sizes != {time_samples.size} or not time_samples.size:
        raise ValueError("the axes of the program do not fit each other")
    return PvtProgram(axes, coordinates, time_samples, period_s)


def _surface(dataset: h5py.Dataset) -> SurfaceMap:
    return SurfaceMap(dataset[:], *(float(dataset.attrs[name]) for name in ("pixel_mm", "x0_mm", "y0_mm")))


def _influence(dataset: h5py.Dataset) -> InfluenceFunction:
    return InfluenceFunction(dataset[:], float(dataset.attrs["pixel_mm"]))


def _prediction(group: h5py.Group) -> Prediction:
    return Prediction(
        group["clear_aperture"][:].astype(bool),
        group["initial_nm"][:],
        group["ideal_residual_nm"][:],
        group["removal_nm"][:],
        group["residual_nm"][:],
    )
