"""What a plan file holds, group by group; `ibfctl.planning.file` names and explains it."""

from __future__ import annotations

import json
from dataclasses import asdict

import h5py
import numpy as np
from pydantic import TypeAdapter

from ibfctl import __version__
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import AxisProgram, PvtProgram
from ibfctl.path.tool_path import ToolPath
from ibfctl.planning.options import PlanOptions
from ibfctl.planning.plan import CurvePoint, DwellPlan, InputFile, Plan, Prediction, Round, Smoothing
from ibfctl.planning.spectra import spectra
from ibfctl.schedule.certificate import Certificate, Check
from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import SurfaceMap

_OPTIONS = TypeAdapter(PlanOptions)
INPUTS = TypeAdapter(dict[str, InputFile])
_CHECKS = TypeAdapter(tuple[Check, ...])
ROUNDS = TypeAdapter(tuple[Round, ...])
_SMOOTHING = TypeAdapter(Smoothing | None)
_CURVE = TypeAdapter(tuple[CurvePoint, ...])
_COMPRESSED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def fill_plan(file: h5py.Group, plan: Plan) -> None:
    """Put the plan of one tool into a file, or into the group of that tool."""
    file.attrs["version"] = __version__
    file.attrs["machine"] = plan.machine.model_dump_json()
    file.attrs["options"] = _OPTIONS.dump_json(plan.options).decode()
    file.attrs["certificate"] = _CHECKS.dump_json(plan.certificate.checks).decode()
    file.attrs["rounds"] = ROUNDS.dump_json(plan.rounds).decode()
    file.attrs["trade_off"] = _CURVE.dump_json(plan.trade_off).decode()
    file.attrs["smoothing"] = _SMOOTHING.dump_json(plan.smoothing).decode()
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
        fill_surface(file, plan.surface)
    if plan.influence is not None:
        dataset = file.create_dataset("influence/rate_nm_s", data=plan.influence.rate_nm_s, **_COMPRESSED)
        dataset.attrs["pixel_mm"] = plan.influence.pixel_mm
    if plan.prediction is not None:
        fill_prediction(file, plan.prediction)
    if plan.prediction is not None and plan.surface is not None:
        fill_spectra(file, plan.prediction, plan.surface.pixel_mm)


def fill_surface(file: h5py.Group, surface: SurfaceMap) -> None:
    """Put a map into `map`."""
    dataset = file.create_dataset("map/height_nm", data=surface.height_nm, **_COMPRESSED)
    for name in ("pixel_mm", "x0_mm", "y0_mm"):
        dataset.attrs[name] = getattr(surface, name)


def fill_prediction(file: h5py.Group, prediction: Prediction) -> None:
    """Put residuals and removal into `prediction`."""
    for name, array in (
        ("residual_nm", prediction.executed_residual_nm),
        ("ideal_residual_nm", prediction.ideal_residual_nm),
        ("initial_nm", prediction.initial_nm),
        ("removal_nm", prediction.executed_removal_nm),
        ("clear_aperture", prediction.clear_aperture),
    ):
        file.create_dataset(f"prediction/{name}", data=array, **_COMPRESSED)
    file["prediction"].attrs.update(file["map/height_nm"].attrs)


def fill_spectra(file: h5py.Group, prediction: Prediction, pixel_mm: float) -> None:
    """Put spectra before and after into `psd`."""
    for name, change in spectra(prediction, pixel_mm).items():
        for column, numbers in (
            ("frequency_per_mm", change.before.frequency_per_mm),
            ("weight", change.before.weight),
            ("before", change.before.density),
            ("after", change.after.density),
        ):
            file.create_dataset(f"psd/{name}/{column}", data=numbers, **_COMPRESSED)


def plan_in(file: h5py.Group) -> Plan:
    """Read back what `fill_plan` has put there."""
    machine = MachineDescription.model_validate_json(file.attrs["machine"])
    return Plan(
        machine,
        _OPTIONS.validate_json(file.attrs["options"]),
        ToolPath(file["path/x_mm"][:], file["path/y_mm"][:]),
        DwellPlan(*(file[f"dwell/{name}"][:] for name in ("x_mm", "y_mm", "time_s"))),
        _program(file["program"]),
        Certificate(_CHECKS.validate_json(file.attrs["certificate"])),
        surface_in(file["map/height_nm"]) if "map" in file else None,
        _influence(file["influence/rate_nm_s"]) if "influence" in file else None,
        prediction_in(file["prediction"]) if "prediction" in file else None,
        ROUNDS.validate_json(file.attrs["rounds"]),
        INPUTS.validate_json(file.attrs["inputs"]),
        float(file.attrs["planning_time_s"]),
        _CURVE.validate_json(file.attrs.get("trade_off", "[]")),
        _SMOOTHING.validate_json(file.attrs.get("smoothing", "null")),
    )


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


def surface_in(dataset: h5py.Dataset) -> SurfaceMap:
    """Read back a map."""
    return SurfaceMap(dataset[:], *(float(dataset.attrs[name]) for name in ("pixel_mm", "x0_mm", "y0_mm")))


def _influence(dataset: h5py.Dataset) -> InfluenceFunction:
    return InfluenceFunction(dataset[:], float(dataset.attrs["pixel_mm"]))


def prediction_in(group: h5py.Group) -> Prediction:
    """Read back residuals and removal."""
    return Prediction(
        group["clear_aperture"][:].astype(bool),
        group["initial_nm"][:],
        group["ideal_residual_nm"][:],
        group["removal_nm"][:],
        group["residual_nm"][:],
    )
