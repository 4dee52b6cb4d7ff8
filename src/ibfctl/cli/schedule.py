"""`ibfctl schedule`: scheduling alone, for dwell times that come from elsewhere."""

from __future__ import annotations

from pathlib import Path

import click

from ibfctl.cli.options import json_option, machine_option, output_option
from ibfctl.cli.output import check_writable, print_json, print_lines
from ibfctl.cli.words import plan_lines


@click.command(name="schedule")
@click.argument("timed_nodes", metavar="TIMED_NODES.csv", type=click.Path(path_type=Path))
@machine_option(required=True)
@click.option("--corridor-mm", type=float, help="How far the path may leave its segment, mm; default: 5 % of a step.")
@output_option("plan.h5")
@json_option
def command(timed_nodes: Path, machine: Path, corridor_mm: float | None, output: Path, as_json: bool) -> None:
    """Schedule nodes whose dwell times are given.

    TIMED_NODES.csv has the columns x_mm,y_mm,dwell_s: the dwell of the segment that ends at the node, 0 in
    the first row.
    """
    check_writable(output, timed_nodes, machine)
    from ibfctl.jobs.plan_files import schedule_file

    plan = schedule_file(timed_nodes, machine, corridor_mm, output)
    if as_json:
        print_json(plan.summary())
    else:
        print_lines([*plan_lines(plan.summary()), ("written", str(output))])
