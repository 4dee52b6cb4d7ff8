"""`ibfctl simulate`: stream a plan to an emulated controller and find what was removed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ibfctl.cli.options import json_option, output_option, speed_option
from ibfctl.cli.output import check_writable, print_json, print_lines
from ibfctl.cli.progress import progress
from ibfctl.cli.words import run_lines
from ibfctl.errors import AbortedError

if TYPE_CHECKING:
    from ibfctl.planning.plan import Plan


@click.command(name="simulate")
@click.argument("plan_file", metavar="PLAN.h5", type=click.Path(path_type=Path))
@speed_option(100.0)
@output_option("run.h5")
@click.option("--yes", is_flag=True, help="Answer yes at every change of tools.")
@json_option
def command(plan_file: Path, speed: float, output: Path, yes: bool, as_json: bool) -> None:
    """Stream PLAN.h5 to an emulated controller over TCP; residual, in nm, from the emulator's own trace.

    The tools of a plan of several run one after the other, each when its change is confirmed.
    """
    check_writable(output, plan_file)
    from ibfctl.jobs.plan_files import hashed
    from ibfctl.jobs.rehearsal import Rehearsal, rehearse
    from ibfctl.jobs.tools_rehearsal import ToolsRehearsal, rehearse_tools
    from ibfctl.planning.file import read_plans, read_sequence

    plans = read_plans(plan_file)
    rehearsal: Rehearsal | ToolsRehearsal
    with progress(plain=len(plans) > 1) as report:
        if len(plans) == 1:
            rehearsal = rehearse(plans[0], output, plan_file=hashed(plan_file), speed=speed, on_progress=report)
        else:
            rehearsal = rehearse_tools(
                read_sequence(plan_file),
                output,
                plan_file=hashed(plan_file),
                confirm=accept_change if yes else ask_for_change,
                speed=speed,
                on_progress=report,
            )
    if as_json:
        print_json(rehearsal.summary())
    else:
        print_lines([*run_lines(rehearsal.summary()), ("written", str(output))])


def accept_change(number: int, plan: Plan) -> None:
    """Take the change of tools as done."""


def ask_for_change(number: int, plan: Plan) -> None:
    """Ask the operator whether the next tool is mounted and its machine referenced."""
    tool = plan.inputs["influence"].name if "influence" in plan.inputs else "the next tool"
    question = f"Tool {number} ({tool}) mounted on {plan.machine.name}, machine referenced?"
    try:
        confirmed = click.confirm(question, err=True)
    except click.Abort as end:
        if isinstance(end.__context__, KeyboardInterrupt):
            raise
        confirmed = False
    if not confirmed:
        raise AbortedError(f"simulate: stopped before tool {number}", "mount it and answer y, or give --yes")
