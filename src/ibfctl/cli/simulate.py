"""`ibfctl simulate`: stream a plan to an emulated controller and find what was removed."""

from __future__ import annotations

from pathlib import Path

import click

from ibfctl.cli.options import json_option, output_option, speed_option
from ibfctl.cli.output import check_writable, print_json, print_lines
from ibfctl.cli.progress import progress
from ibfctl.cli.words import run_lines


@click.command(name="simulate")
@click.argument("plan_file", metavar="PLAN.h5", type=click.Path(path_type=Path))
@speed_option(100.0)
@output_option("run.h5")
@json_option
def command(plan_file: Path, speed: float, output: Path, as_json: bool) -> None:
    """Stream PLAN.h5 to an emulated controller over TCP; residual, in nm, from the emulator's own trace."""
    check_writable(output)
    from ibfctl.jobs.plan_files import hashed
    from ibfctl.jobs.rehearsal import rehearse
    from ibfctl.planning.file import read_plan

    plan = read_plan(plan_file)
    with progress() as report:
        rehearsal = rehearse(plan, output, plan_file=hashed(plan_file), speed=speed, on_progress=report)
    if as_json:
        print_json(rehearsal.summary())
    else:
        print_lines([*run_lines(rehearsal.summary()), ("written", str(output))])
