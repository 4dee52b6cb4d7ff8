"""The files that show a plan to others: exports of its program, tables and pictures, for every one of its tools."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

PLAN = "plan.h5"
RESIDUAL = "residual.npz"
PICTURES = ("map.png", "dwell.png", "velocities.png", "psd.png")
OF_A_TOOL = ("plan.csv", "plan.pvt.csv", "plan.pvt.dmc", "plan.gcode", "dwell.npz", RESIDUAL, *PICTURES)


def of_tool(name: str, number: int) -> str:
    """Return the name of the file of one of several tools, counted from one: a mark before its suffixes."""
    stem, _, suffixes = name.partition(".")
    return f"{stem}.tool{number}.{suffixes}"


def artefact_names(tools: int) -> tuple[str, ...]:
    """Return the names of all files of a plan, `plan.h5` first; of several tools each has its own plan file as well."""
    if tools == 1:
        return (PLAN, *OF_A_TOOL)
    each = [of_tool(name, number) for number in range(1, tools + 1) for name in (PLAN, *OF_A_TOOL)]
    return (PLAN, RESIDUAL, *each)


def write_artefacts(plan_file: Path, folder: Path) -> None:
    """Write all files of a plan but itself to a folder, each completely or not at all.

    Raises
    ------
    InputError
        If the plan cannot be read, or a file cannot be written.
    """
    # Whoever asks for the names alone waits for no planner to load.
    from ibfctl.planning.file import read_plans, read_sequence, write_plan
    from ibfctl.planning.plan import Plan
    from ibfctl.planning.sequence import PlanSequence

    def write_residual(made: Plan | PlanSequence, path: Path) -> None:
        from ibfctl.files import save_npz

        surface, prediction = made.surface, made.prediction
        if surface is None or prediction is None:
            return
        height_nm = prediction.executed_residual_nm
        save_npz(path, height_nm=height_nm, pixel_mm=surface.pixel_mm, x0_mm=surface.x0_mm, y0_mm=surface.y0_mm)

    def write_tool(plan: Plan, place: Path) -> None:
        from ibfctl.files import save_npz
        from ibfctl.report.exchange import FORMATS, write_exchange
        from ibfctl.report.pictures import draw_plan

        for form in FORMATS:
            write_exchange(plan, form, f"ibfctl plan {folder.name}", place / f"plan.{form}")
        save_npz(place / "dwell.npz", **dataclasses.asdict(plan.dwell))
        write_residual(plan, place / RESIDUAL)
        draw_plan(plan, place)

    plans = read_plans(plan_file)
    if len(plans) == 1:
        write_tool(plans[0], folder)
        return
    write_residual(read_sequence(plan_file), folder / RESIDUAL)
    for number, plan in enumerate(plans, 1):
        with tempfile.TemporaryDirectory(dir=folder) as name:
            write_plan(plan, Path(name) / PLAN)
            write_tool(plan, Path(name))
            for written in sorted(Path(name).iterdir()):
                written.replace(folder / of_tool(written.name, number))
