"""`ibfctl tools`: which tools are worth their time on a part, and the plan of several taken apart for their runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ibfctl.cli.options import (
    NOT_NEGATIVE,
    POSITIVE,
    covering_options,
    json_option,
    machine_option,
    output_option,
    unit_options,
)
from ibfctl.cli.output import check_writable, print_json, print_lines
from ibfctl.cli.progress import progress
from ibfctl.cli.tool_options import ToolSpec, tool_change_option, tool_files, tools_argument
from ibfctl.cli.words import plan_lines, subset_table, tool_table


@click.group(name="tools")
def command() -> None:
    """Several tools on one part."""


@command.command()
@click.argument("surface_map", metavar="MAP")
@tools_argument
@machine_option(required=False)
@tool_change_option
@click.option("--margin", type=NOT_NEGATIVE, help="Share of the residual given for time; default: 0.01.")
@click.option("--seconds-per-nm", type=POSITIVE, help="Seconds of total time that a nm RMS of residual is worth.")
@covering_options
@unit_options
@json_option
def suggest(
    surface_map: str,
    tools: tuple[ToolSpec, ...],
    machine: Path | None,
    tool_change_s: float,
    margin: float | None,
    seconds_per_nm: float | None,
    map_pixel_mm: float | None,
    map_unit: str | None,
    map_array: str | None,
    tif_pixel_mm: float | None,
    tif_unit: str | None,
    as_json: bool,
    **choices: Any,
) -> None:
    """Compare every subset of the tools: residual, time, and what is left at which wavelengths.

    Each TIF is as after --tool of `ibfctl plan`. Without a machine no limits count. Nothing is scheduled or written.
    """
    if margin is not None and seconds_per_nm is not None:
        raise click.UsageError("--margin and --seconds-per-nm exclude each other.")
    from ibfctl.jobs.inputs import MapFile
    from ibfctl.jobs.tool_files import suggest_files
    from ibfctl.planning.options import Aim, PlanOptions

    aim = Aim(Aim().margin if margin is None else margin, seconds_per_nm=seconds_per_nm)
    with progress() as report:
        suggestion = suggest_files(
            MapFile(surface_map, map_pixel_mm, map_unit, map_array),
            tool_files(tools, machine, tif_pixel_mm, tif_unit),
            PlanOptions(aim=aim, **choices),
            tool_change_s,
            on_progress=report,
        )
    figures = suggestion.summary()
    if as_json:
        print_json(figures)
    else:
        click.echo("\n".join(subset_table(figures, [tool.influence for tool in tools])))


@command.command()
@click.argument("plan_file", metavar="PLAN.h5", type=click.Path(path_type=Path))
@json_option
def split(plan_file: Path, as_json: bool) -> None:
    """Write the plan of every tool of PLAN.h5 as an ordinary plan file beside it, to be run by itself."""
    from ibfctl.jobs.tool_runs import split_file

    written = [str(path) for path in split_file(plan_file)]
    if as_json:
        print_json({"written": written})
    else:
        click.echo("\n".join(f"written  {path}" for path in written))


@command.command()
@click.argument("plan_file", metavar="PLAN.h5", type=click.Path(path_type=Path))
@click.argument("runs", metavar="RUN.h5...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--done", type=click.IntRange(min=1), help="How many tools are through; default: one for each run.")
@output_option("later.h5")
@json_option
def replan(plan_file: Path, runs: tuple[Path, ...], done: int | None, output: Path, as_json: bool) -> None:
    """Plan the later tools of PLAN.h5 anew, from what the runs of the earlier ones have really removed."""
    check_writable(output, plan_file, *runs)
    from ibfctl.jobs.tool_runs import replan_tools_file

    figures = replan_tools_file(plan_file, runs, output, done).summary()
    if as_json:
        print_json(figures)
    else:
        print_lines([*plan_lines(figures), ("written", str(output))])
        click.echo("\n".join(tool_table(figures)))
