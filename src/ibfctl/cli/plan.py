"""`ibfctl plan`: from a map and an influence function to a certified plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import click

from ibfctl.cli.options import (
    NOT_NEGATIVE,
    POSITIVE,
    bounds_options,
    covering_options,
    json_option,
    machine_option,
    output_option,
    unit_options,
)
from ibfctl.cli.output import check_writable, print_json, print_lines
from ibfctl.cli.placement import placed, placement_options
from ibfctl.cli.progress import progress
from ibfctl.cli.tool_options import ToolSpec, tool_files, tool_options
from ibfctl.cli.words import plan_lines, tool_table, trade_off_table

if TYPE_CHECKING:
    from ibfctl.planning.options import MadePath
    from ibfctl.planning.plan import Plan
    from ibfctl.planning.sequence import Method

_MADE_PATHS = ("raster", "maze", "spiral", "random")
_L_CURVE = "l-curve"


def _tikhonov(ctx: click.Context, param: click.Parameter, value: str | None) -> float | str | None:
    """Take a factor, or the word for finding it."""
    if value is None or value == _L_CURVE:
        return value
    try:
        factor = float(value)
    except ValueError:
        factor = -1.0
    if not 0 <= factor <= 1:
        raise click.BadParameter(f"{value!r} is neither a factor from 0 to 1 nor {_L_CURVE}.", ctx, param)
    return factor


@click.command(name="plan")
@click.argument("surface_map", metavar="MAP")
@click.argument("influence", metavar="[TIF]", required=False)
@machine_option(required=False)
@tool_options
@click.option(
    "--path",
    default="raster",
    show_default=True,
    metavar="raster|maze|spiral|random|NODES.csv",
    help="Raster, random maze, spiral, random adaptive path, or nodes: x_mm,y_mm.",
)
@click.option("--scan-axis", type=click.Choice(["x", "y"]), default="x", show_default=True, help="Axis of the lines.")
@covering_options
@placement_options
@bounds_options
@click.option("--margin", type=NOT_NEGATIVE, help="Share of the residual given for time; default: 0.01.")
@click.option("--max-time", type=POSITIVE, help="Longest run time, s: the best residual within it.")
@click.option("--max-residual", type=POSITIVE, help="Allowed residual, nm RMS: the shortest time to it.")
@click.option("--seconds-per-nm", type=POSITIVE, help="Seconds of total time that a nm RMS of residual is worth.")
@click.option("--loop/--no-loop", default=True, show_default=True, help="Correct dwell times for the motion executed.")
@click.option(
    "--tikhonov",
    metavar="VALUE|l-curve",
    callback=_tikhonov,
    help="Tikhonov factor, relative to the largest eigenvalue, or found by the L-curve; default: 1e-8.",
)
@click.option("--trade-off", is_flag=True, help="Show the whole curve of residual against time.")
@unit_options
@output_option("plan.h5")
@json_option
def command(
    surface_map: str,
    influence: str | None,
    machine: Path | None,
    tools: tuple[ToolSpec, ...],
    method: str,
    tool_change_s: float,
    path: str,
    scan_axis: str,
    margin: float | None,
    max_time: float | None,
    max_residual: float | None,
    seconds_per_nm: float | None,
    loop: bool,
    tikhonov: float | str | None,
    trade_off: bool,
    map_pixel_mm: float | None,
    map_unit: str | None,
    map_array: str | None,
    tif_pixel_mm: float | None,
    tif_unit: str | None,
    output: Path,
    as_json: bool,
    **choices: Any,
) -> None:
    """Plan a job: from MAP and TIF to a certified program for the machine.

    MAP is a surface (.npz, .mat, .csv, .xyz); TIF is the tool influence function: such a file, or
    gaussian:fwhm_mm=..,peak_nm_s=..,radius_mm=.. Instead of TIF, --tool may name several, used one after the other.
    """
    if sum(choice is not None for choice in (margin, max_time, max_residual, seconds_per_nm)) > 1:
        raise click.UsageError("--margin, --max-time, --max-residual and --seconds-per-nm exclude each other.")
    if (influence is None) == (not tools):
        raise click.UsageError("Give either TIF or --tool.")
    if tools and (trade_off or tikhonov == _L_CURVE):
        raise click.UsageError("--trade-off and --tikhonov l-curve are for one TIF, not for --tool.")
    check_writable(output, surface_map, influence, machine, path, *(tool.influence for tool in tools))
    from ibfctl.jobs.inputs import InfluenceFile, MapFile
    from ibfctl.jobs.plan_files import plan_files
    from ibfctl.jobs.tool_files import plan_tool_files
    from ibfctl.planning.options import Aim, PlanOptions

    default = PlanOptions()
    options = PlanOptions(
        path=cast("MadePath", path) if path in _MADE_PATHS else Path(path),
        scan_axis=cast('Literal["x", "y"]', scan_axis),
        loop=loop,
        aim=Aim(default.aim.margin if margin is None else margin, max_time, max_residual, seconds_per_nm),
        tikhonov=tikhonov if isinstance(tikhonov, float) else default.tikhonov,
        l_curve=tikhonov == _L_CURVE,
        trade_off=trade_off,
        **placed(choices),
    )
    surface = MapFile(surface_map, map_pixel_mm, map_unit, map_array)
    if influence is None:
        files = tool_files(tools, machine, tif_pixel_mm, tif_unit)
        for file in files:
            if file.machine is None:
                raise click.UsageError(
                    f"--tool {file.influence.spec} has no machine: add :machine=FILE, or give --machine."
                )
        with progress() as report:
            together = plan_tool_files(
                surface, files, options, output, cast("Method", method), tool_change_s, on_progress=report
            ).summary()
        if as_json:
            print_json(together)
        else:
            print_lines([*plan_lines(together), ("written", str(output))])
            click.echo("\n".join(tool_table(together)))
        return
    if machine is None:
        raise click.UsageError("Missing option '--machine'.")
    with progress() as report:
        plan = plan_files(
            surface,
            InfluenceFile(influence, tif_pixel_mm, tif_unit),
            machine,
            options,
            output,
            on_progress=report,
        )
    figures = plan.summary()
    if as_json:
        print_json(figures)
        return
    print_lines([*plan_lines(figures), *_advice(plan), ("written", str(output))])
    if plan.trade_off:
        click.echo("\n".join(trade_off_table(plan.trade_off)))


def _advice(plan: Plan) -> list[tuple[str, str]]:
    """Say what the plan's figures do not hold: the factor that was found, and the speed advised for the steps."""
    from ibfctl.planning.advice import advised_speeds_mm_s

    low, high = advised_speeds_mm_s(plan.stage_path, plan.machine)
    factor = [("Tikhonov factor", f"{plan.options.tikhonov:.2g}")] if plan.options.l_curve else []
    return [*factor, ("advised top speed", f"{low:.3g} to {high:.3g} mm/s (0.6 to 0.8 of the characteristic speed)")]
