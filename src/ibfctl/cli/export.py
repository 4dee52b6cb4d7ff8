"""`ibfctl export`: the program of a plan as text."""

from __future__ import annotations

from pathlib import Path

import click

from ibfctl.cli.output import check_writable

_FORMATS = ("csv", "pvt.csv", "pvt.dmc")


@click.command(name="export")
@click.argument("plan_file", metavar="PLAN.h5", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "form",
    type=click.Choice(_FORMATS),
    required=True,
    help="Plain CSV, or what Galil's PVT tool opens.",
)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="File to write; default: PLAN.FORMAT.")
def command(plan_file: Path, form: str, output: Path | None) -> None:
    """Write the program of PLAN.h5 as text: positions in counts, velocities in counts/s, times in samples."""
    output = output if output is not None else plan_file.with_suffix(f".{form}")
    check_writable(output)
    from ibfctl.planning.file import read_plan
    from ibfctl.report.exchange import write_exchange

    write_exchange(read_plan(plan_file).program, form, f"ibfctl plan {plan_file.name}", output)
    click.echo(f"written  {output}")
