"""`ibfctl plan`: from a map and an influence function to a certified plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

import click

from ibfctl.cli.options import covering_options, json_option, machine_option, output_option, unit_options
from ibfctl.cli.output import check_writable, print_json, print_lines
from ibfctl.cli.progress import progress
from ibfctl.cli.words import plan_lines

if TYPE_CHECKING:
    from ibfctl.surface.map import Rectangle

_MADE_PATHS = ("raster", "maze")
_POSITIVE = click.FloatRange(min=0, min_open=True)


@click.command(name="plan")
@click.argument("surface_map", metavar="MAP")
@click.argument("influence", metavar="TIF")
@machine_option(required=True)
@click.option(
    "--path",
    default="raster",
    show_default=True,
    metavar="raster|maze|NODES.csv",
    help="Raster, random maze, or nodes: x_mm,y_mm.",
)
@click.option("--scan-axis", type=click.Choice(["x", "y"]), default="x", show_default=True, help="Axis of the lines.")
@covering_options
@click.option("--dwell-min-s", type=float, help="Lower bound of every dwell time, s; default: the machine's own.")
@click.option("--max-time", type=_POSITIVE, help="Longest run time, s: the best residual within it.")
@click.option("--max-residual", type=_POSITIVE, help="Allowed residual, nm RMS: the shortest time to it.")
@click.option("--loop/--no-loop", default=True, show_default=True, help="Correct dwell times for the motion executed.")
@unit_options
@output_option("plan.h5")
@json_option
def command(
    surface_map: str,
    influence: str,
    machine: Path,
    path: str,
    seed: int,
    pitch_mm: float,
    step_mm: float,
    scan_axis: str,
    clear_aperture: Rectangle | None,
    remove: str,
    dwell_min_s: float | None,
    corridor_mm: float | None,
    max_time: float | None,
    max_residual: float | None,
    loop: bool,
    map_pixel_mm: float | None,
    map_unit: str | None,
    map_array: str | None,
    tif_pixel_mm: float | None,
    tif_unit: str | None,
    output: Path,
    as_json: bool,
) -> None:
    """Plan a job: from MAP and TIF to a certified program for the machine.

    MAP is a surface (.npz, .mat, .csv, .xyz); TIF is the tool influence function: such a file, or
    gaussian:fwhm_mm=..,peak_nm_s=..,radius_mm=..
    """
    if max_time is not None and max_residual is not None:
        raise click.UsageError("--max-time and --max-residual exclude each other.")
    check_writable(output)
    from ibfctl.jobs.plan_files import InfluenceFile, MapFile, plan_files
    from ibfctl.planning.options import Aim, PlanOptions, Removed

    options = PlanOptions(
        path=cast('Literal["raster", "maze"]', path) if path in _MADE_PATHS else Path(path),
        seed=seed,
        pitch_mm=pitch_mm,
        step_mm=step_mm,
        scan_axis=cast('Literal["x", "y"]', scan_axis),
        clear_aperture=clear_aperture,
        remove=cast(Removed, remove),
        dwell_min_s=dwell_min_s,
        corridor_mm=corridor_mm,
        loop=loop,
        aim=Aim(max_time_s=max_time, max_residual_nm=max_residual),
    )
    with progress() as report:
        plan = plan_files(
            MapFile(surface_map, map_pixel_mm, map_unit, map_array),
            InfluenceFile(influence, tif_pixel_mm, tif_unit),
            machine,
            options,
            output,
            on_progress=report,
        )
    if as_json:
        print_json(plan.summary())
    else:
        print_lines([*plan_lines(plan.summary()), ("written", str(output))])
