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
    `format`, `version` (of ibfctl), `machine`, `options`, `certificate`, `rounds`, `trade_off`, `smoothing`,
    `inputs` (names and SHA-256), all JSON, and `planning_time_s`. `/map`, `/influence`, `/prediction` and `/psd` are
    absent where only a schedule was made.

A plan for several tools has another `format`. Each ``/tools/<n>``, counted from one in the order in which they run,
holds all of the above but `format`; ``/map``, ``/prediction`` and ``/psd`` are those of all tools together.

The file is sealed: a program whose scale or counts were changed on a disk must not reach a machine.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import h5py
from pydantic import TypeAdapter, ValidationError

from ibfctl import __version__
from ibfctl.errors import InputError
from ibfctl.hdf5 import check_seal, new_file
from ibfctl.planning.groups import (
    INPUTS,
    ROUNDS,
    fill_plan,
    fill_prediction,
    fill_spectra,
    fill_surface,
    plan_in,
    prediction_in,
    surface_in,
)
from ibfctl.planning.plan import Plan
from ibfctl.planning.sequence import Method, PlanSequence

FORMAT = "ibfctl-plan/1"
SEVERAL_FORMAT = "ibfctl-tools-plan/1"
_METHOD: TypeAdapter[Method] = TypeAdapter(Method)


def write_plan(plan: Plan, path: Path) -> None:
    """Write `plan` to `path`: a new file appears whole or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with new_file(path, sealed=True) as file:
        file.attrs["format"] = FORMAT
        fill_plan(file, plan)


def write_sequence(sequence: PlanSequence, path: Path) -> None:
    """Write the plan of several tools to `path`; one tool alone makes an ordinary plan file.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    if len(sequence.plans) == 1:
        write_plan(sequence.plans[0], path)
        return
    with new_file(path, sealed=True) as file:
        file.attrs["format"] = SEVERAL_FORMAT
        file.attrs["version"] = __version__
        file.attrs["method"] = sequence.method
        file.attrs["tool_change_s"] = sequence.tool_change_s
        file.attrs["rounds"] = ROUNDS.dump_json(sequence.rounds).decode()
        file.attrs["inputs"] = json.dumps({role: asdict(item) for role, item in sequence.inputs.items()})
        file.attrs["planning_time_s"] = sequence.planning_time_s
        fill_surface(file, sequence.surface)
        fill_prediction(file, sequence.prediction)
        fill_spectra(file, sequence.prediction, sequence.surface.pixel_mm)
        for number, plan in enumerate(sequence.plans, 1):
            fill_plan(file.create_group(f"tools/{number}"), plan)


def read_plan(path: Path, tool: int | None = None) -> Plan:
    """Read the plan of one tool.

    Parameters
    ----------
    tool
        Which of several tools, counted from one; None where the file is for a single one.

    Raises
    ------
    InputError
        If it cannot be read, is no plan file, is damaged, or does not hold that tool.
    """
    plans = read_plans(path)
    if tool is None and len(plans) > 1:
        raise InputError(
            f"plan file {path}: holds the plans of {len(plans)} tools", "take them apart with `ibfctl tools split`"
        )
    number = 1 if tool is None else tool
    if not 1 <= number <= len(plans):
        raise InputError(f"plan file {path}: has no tool {number}", f"choose one of 1 to {len(plans)}")
    return plans[number - 1]


def read_plans(path: Path) -> tuple[Plan, ...]:
    """Read the plans of all tools, in the order in which they run; one where the file is for a single tool.

    Raises
    ------
    InputError
        As `read_plan` does.
    """
    with _readable(path) as file:
        if file.attrs.get("format") == SEVERAL_FORMAT:
            return _plans(file)
        if file.attrs.get("format") != FORMAT:
            raise InputError(f"plan file {path}: not a plan of this version", "make it anew with `ibfctl plan`")
        return (plan_in(file),)


def read_sequence(path: Path) -> PlanSequence:
    """Read the plan of several tools.

    Raises
    ------
    InputError
        If it cannot be read, is no plan of several tools, or is damaged.
    """
    with _readable(path) as file:
        if file.attrs.get("format") != SEVERAL_FORMAT:
            raise InputError(f"plan file {path}: not a plan of several tools", "make one with `ibfctl plan --tool`")
        return PlanSequence(
            _plans(file),
            surface_in(file["map/height_nm"]),
            prediction_in(file["prediction"]),
            _METHOD.validate_python(file.attrs["method"]),
            float(file.attrs["tool_change_s"]),
            ROUNDS.validate_json(file.attrs["rounds"]),
            INPUTS.validate_json(file.attrs["inputs"]),
            float(file.attrs["planning_time_s"]),
        )


def _plans(file: h5py.File) -> tuple[Plan, ...]:
    tools = file["tools"]
    if not len(tools):
        raise ValueError("it holds no tool")
    return tuple(plan_in(tools[str(number)]) for number in range(1, len(tools) + 1))


@contextlib.contextmanager
def _readable(path: Path) -> Iterator[h5py.File]:
    try:
        check_seal(path)
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError, ValidationError) as error:
        if isinstance(error, InputError):
            raise
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"plan file {path}: cannot be read ({reason})", "give a plan.h5 that `ibfctl plan` or `schedule` wrote"
        ) from error
