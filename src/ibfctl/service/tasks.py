"""Numerical work of the service, in processes of their own.

``python -m ibfctl.service.tasks NAME`` reads one line of JSON with the task's arguments and prints JSON lines with
an ``event``: ``progress``, and at the end ``finished`` or ``failed``; the exit code is that of the error, or 0.
The end of standard input (a dead parent closes it) cancels a plan. Every task imports what it needs itself: reading a
map must not wait for a solver to load.
"""

from __future__ import annotations

import dataclasses
import json
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np

from ibfctl.errors import IbfctlError, InputError
from ibfctl.files import save_npz
from ibfctl.jobs.inputs import InfluenceFile, MapFile

Arguments = dict[str, Any]


def inspect_map(arguments: Arguments) -> Arguments:
    """Read a map and return its figures."""
    most = arguments.pop("max_pixels")
    surface = MapFile(**arguments).read()
    _refuse_large(surface.height_nm.shape, most)
    valid_nm = surface.height_nm[np.isfinite(surface.height_nm)]
    ny, nx = surface.height_nm.shape
    return {
        "nx": nx,
        "ny": ny,
        "pixel_mm": surface.pixel_mm,
        "x0_mm": surface.x0_mm,
        "y0_mm": surface.y0_mm,
        "valid_pixels": int(valid_nm.size),
        "rms_nm": float(valid_nm.std()),
        "pv_nm": float(np.ptp(valid_nm)),
    }


def inspect_influence(arguments: Arguments) -> Arguments:
    """Read an influence function and return its figures."""
    most = arguments.pop("max_pixels")
    influence = InfluenceFile(**arguments).read()
    _refuse_large(influence.rate_nm_s.shape, most)
    ny, nx = influence.rate_nm_s.shape
    return {
        "nx": nx,
        "ny": ny,
        "pixel_mm": influence.pixel_mm,
        "radius_mm": influence.radius_mm,
        "peak_rate_nm_s": influence.peak_rate_nm_s,
        "volume_rate_nm_mm2_s": influence.volume_rate_nm_mm2_s,
    }


def inspect_plan(arguments: Arguments) -> Arguments:
    """Read a plan file, of one tool or of several, and return its summary."""
    from ibfctl.planning.file import read_plans, read_sequence

    path = Path(arguments["path"])
    plans = read_plans(path)
    if plans[0].prediction is None or plans[0].surface is None:
        raise InputError(f"{path}: holds no map, so that nothing is known of its residual", "plan from a map")
    _refuse_large(plans[0].surface.height_nm.shape, arguments["max_pixels"])
    made = plans[0] if len(plans) == 1 else read_sequence(path)
    return {"tools": len(plans), "summary": made.summary()}


def plan(arguments: Arguments) -> Arguments:
    """Plan a job, of one tool or of several, and write the plan; return its summary."""
    from ibfctl.jobs.plan_files import plan_files
    from ibfctl.jobs.tool_files import ToolFile, plan_tool_files
    from ibfctl.planning.options import Aim, PlanOptions
    from ibfctl.runs.promptness import let_others_go_first

    let_others_go_first()
    options = dict(arguments["options"])
    options["clear_aperture"] = _region(options["clear_aperture"], Path(arguments["output"]).parent)
    options["placement"] = _placement(options["placement"])
    options["aim"] = Aim(**options["aim"])
    surface, chosen, output = MapFile(**arguments["map"]), PlanOptions(**options), Path(arguments["output"])
    watched: Any = {
        "on_progress": lambda stage, fraction: _print("progress", stage=stage, fraction=fraction),
        "cancelled": _parent_is_gone(),
    }
    if "tools" not in arguments:
        influence, machine = InfluenceFile(**arguments["influence"]), Path(arguments["machine"])
        return plan_files(surface, influence, machine, chosen, output, **watched).summary()
    tools = [
        ToolFile(**{**tool, "influence": InfluenceFile(**tool["influence"]), "machine": Path(tool["machine"])})
        for tool in arguments["tools"]
    ]
    method, tool_change_s = arguments["method"], arguments["tool_change_s"]
    return plan_tool_files(surface, tools, chosen, output, method, tool_change_s, **watched).summary()


def _region(given: Any, folder: Path) -> Any:
    """Make a region of x0, x1, y0, y1, a circle, a polygon, or the map of a mask, which is kept in `folder`."""
    from ibfctl.surface.map import Rectangle
    from ibfctl.surface.regions import Circle, MaskFile, Polygon

    match given:
        case {"circle": circle}:
            return Circle(*circle)
        case {"polygon": points_mm}:
            return Polygon(tuple((x_mm, y_mm) for x_mm, y_mm in points_mm))
        case {"mask": surface}:
            path = folder / "mask.npy"
            np.save(path, np.isfinite(MapFile(**surface).read().height_nm))
            return MaskFile(path)
        case None:
            return None
    return Rectangle(*given)


def _placement(given: Any) -> Any:
    """Make a placement from what is given, or fit it to fiducials."""
    from ibfctl.machine.placement import AS_MOUNTED, Placement, fit_placement

    match given:
        case None:
            return AS_MOUNTED
        case {"fiducials_mm": pairs, "mirrored": mirrored, "limit_mm": limit_mm}:
            pairs_mm = np.array(pairs)
            return fit_placement(pairs_mm[:, :2], pairs_mm[:, 2:], mirrored=mirrored, limit_mm=limit_mm)
    x_mm, y_mm = given["offset_mm"]
    return Placement(x_mm, y_mm, given["rotation_deg"], given["mirrored"])


def run_report(arguments: Arguments) -> Arguments:
    """Return the figures of a run file."""
    from ibfctl.runs.run_file import read_as_run

    as_run = read_as_run(Path(arguments["run"]))
    if as_run is None:
        return {}
    return {
        "as_run_rms_nm": as_run.rms_nm,
        "as_run_pv_nm": as_run.pv_nm,
        "max_difference_nm": as_run.max_difference_nm,
        "rms_difference_nm": as_run.rms_difference_nm,
    }


def recover_run(arguments: Arguments) -> Arguments:
    """Make the machine of an interrupted run safe, and find out what was executed of it."""
    from ibfctl.runs.recovery import recover

    return dataclasses.asdict(recover(Path(arguments["folder"])))


def resume_run(arguments: Arguments) -> Arguments:
    """Recover an interrupted run, and start a worker that goes on at the seam."""
    from ibfctl.runs.launch import let_go
    from ibfctl.runs.recovery import recover, resume

    found = recover(Path(arguments["folder"]))
    let_go(resume(Path(arguments["folder"]), found))
    return dataclasses.asdict(found)


def preview_map(arguments: Arguments) -> Arguments:
    """Draw a map."""
    from ibfctl.report.preview import draw_map

    draw_map(MapFile(**arguments["map"]).read(), Path(arguments["folder"]) / "preview.png")
    return {}


def plan_files_of(arguments: Arguments) -> Arguments:
    """Write exports, tables and pictures of a plan."""
    from ibfctl.jobs.plan_artefacts import write_artefacts

    write_artefacts(Path(arguments["plan"]), Path(arguments["folder"]))
    return {}


def run_files_of(arguments: Arguments) -> Arguments:
    """Write the table and the picture of what a run has left."""
    from ibfctl.planning.file import read_plans, read_sequence
    from ibfctl.report.pictures import draw_run
    from ibfctl.runs.run_file import read_as_run

    folder = Path(arguments["folder"])
    plans = read_plans(Path(arguments["plan"]))
    made = plans[0] if len(plans) == 1 else read_sequence(Path(arguments["plan"]))
    as_run = read_as_run(Path(arguments["run"]))
    if as_run is None or made.surface is None:
        return {}
    save_npz(
        folder / "residual.npz",
        height_nm=as_run.residual_nm,
        pixel_mm=made.surface.pixel_mm,
        x0_mm=made.surface.x0_mm,
        y0_mm=made.surface.y0_mm,
    )
    draw_run(made, as_run, folder)
    return {}


TASKS: dict[str, Callable[[Arguments], Arguments]] = {
    "inspect-map": inspect_map,
    "inspect-influence": inspect_influence,
    "inspect-plan": inspect_plan,
    "plan": plan,
    "run-report": run_report,
    "recover-run": recover_run,
    "resume-run": resume_run,
    "preview-map": preview_map,
    "plan-files": plan_files_of,
    "run-files": run_files_of,
}


def main() -> int:
    """Do one task; return the exit code."""
    arguments = cast(Arguments, json.loads(sys.stdin.readline()))
    try:
        figures = TASKS[sys.argv[1]](arguments)
    except IbfctlError as error:
        _print("failed", code=error.code, message=error.message, hint=error.hint)
        return error.exit_code
    _print("finished", figures=figures)
    return 0


def _refuse_large(shape: tuple[int, ...], most: int) -> None:
    ny, nx = shape
    if nx * ny > most:
        raise InputError(f"{nx} x {ny} pixels are more than the {most} that this service takes", "crop or bin it")


def _parent_is_gone() -> Callable[[], bool]:
    gone = threading.Event()

    def watch() -> None:
        while os.read(0, 4096):
            pass
        gone.set()

    threading.Thread(target=watch, name="parent", daemon=True).start()
    return gone.is_set


def _print(event: str, **fields: Any) -> None:
    print(json.dumps({"event": event, **fields}), flush=True)


if __name__ == "__main__":
    sys.exit(main())
