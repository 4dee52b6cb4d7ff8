"""`ibfctl export`: the program of a plan as text, and maps of plans and runs."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, cast

import click

from ibfctl.cli.options import json_option
from ibfctl.cli.output import check_writable, print_json

_FORMATS = ("csv", "pvt.csv", "pvt.dmc", "gcode")


@click.command(name="export")
@click.argument("source", metavar="FILE.h5", type=click.Path(path_type=Path))
@click.option(
    "--format", "form", type=click.Choice(_FORMATS), help="Plain CSV, what Galil's PVT tool opens, or G-code."
)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="File to write; default: FILE.FORMAT.")
@click.option("--map", "map_file", type=click.Path(path_type=Path), help="Map to write: .datx, .h5, .npz, .xyz, .csv.")
@click.option(
    "--quantity",
    type=click.Choice(["residual", "removal"]),
    default="residual",
    show_default=True,
    help="What the map shows: predicted by a plan, as run by a run.",
)
@json_option
def command(
    source: Path, form: str | None, output: Path | None, map_file: Path | None, quantity: str, as_json: bool
) -> None:
    """Write the program of a plan as text, or a map of a plan or a run for other programs.

    Programs have positions in counts, velocities in counts/s, times in samples; maps have heights in nm.
    """
    if (form is None) == (map_file is None):
        raise click.UsageError("Give either --format or --map.")
    if form is not None:
        written = output if output is not None else source.with_suffix(f".{form}")
        _write_program(source, form, written)
    else:
        written = cast(Path, map_file)
        _write_map(source, cast(Literal["residual", "removal"], quantity), written)
    if as_json:
        print_json({"written": str(written)})
    else:
        click.echo(f"written  {written}")


def _write_program(source: Path, form: str, output: Path) -> None:
    check_writable(output, source)
    from ibfctl.planning.file import read_plan
    from ibfctl.report.exchange import write_exchange

    write_exchange(read_plan(source), form, f"ibfctl plan {source.name}", output)


def _write_map(source: Path, quantity: Literal["residual", "removal"], output: Path) -> None:
    check_writable(output, source)
    from ibfctl.jobs.written_maps import written_map
    from ibfctl.surface.writers import write_map

    write_map(written_map(source, quantity), output)
