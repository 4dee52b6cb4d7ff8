"""`ibfctl demo`: the whole way, from a made map to the as-run residual."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import click

from ibfctl.cli.options import json_option, speed_option
from ibfctl.cli.output import print_json
from ibfctl.cli.progress import progress
from ibfctl.cli.words import demo_table
from ibfctl.errors import InputError


@click.command(name="demo")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default="demo-results",
    show_default=True,
    help="Folder for plan.h5, run.h5 and pictures; made if absent.",
)
@speed_option(25.0)
@json_option
def command(out: Path, speed: float, as_json: bool) -> None:
    """Plan a made 92 x 16 mm flat, run it on an emulated controller, and show what was left of its error."""
    if find_spec("matplotlib") is None:
        raise InputError("demo: its pictures need matplotlib, which is not installed", "pip install 'ibfctl[plots]'")
    from ibfctl.demo.job import demo_job
    from ibfctl.demo.run import run_demo
    from ibfctl.machine.description import read_machine
    from ibfctl.machine.shipped import shipped_machine

    machine = shipped_machine("simulator")
    with progress() as report:
        demo = run_demo(demo_job(), machine, out, speed=speed, on_progress=report)
    if as_json:
        print_json(demo.summary())
        return
    click.echo("\n".join(demo_table(demo.summary(), read_machine(machine))))
    click.echo(f"\nresults in {out}: {', '.join(path.name for path in demo.files)}")
