"""`ibfctl replan`: plan what an interrupted run has left."""

from __future__ import annotations

from pathlib import Path

import click

from ibfctl.cli.options import json_option, output_option
from ibfctl.cli.output import check_writable, print_json, print_lines
from ibfctl.cli.progress import progress
from ibfctl.cli.words import plan_lines


@click.command(name="replan")
@click.argument("run_file", metavar="RUN.h5", type=click.Path(path_type=Path))
@output_option("rest.h5")
@json_option
def command(run_file: Path, output: Path, as_json: bool) -> None:
    """Plan the rest of an interrupted run: from RUN.h5 to a plan from where it ended, for what its map still shows."""
    check_writable(output, run_file)
    from ibfctl.jobs.replan_file import replan_file
    from ibfctl.surface.levelling import rms

    with progress() as report:
        left, plan = replan_file(run_file, output, report)
    period_s = left.plan.program.sample_period_s
    prediction = left.plan.prediction
    first_nm = None if prediction is None else rms(prediction.executed_residual_nm[prediction.clear_aperture])
    figures = plan.summary() | {
        "executed_s": left.seam * period_s,
        "uncertainty_s": left.uncertainty_samples * period_s,
        "first_executed_rms_nm": first_nm,
    }
    if as_json:
        print_json(figures)
        return
    lines = [
        ("executed before", f"{figures['executed_s']:.1f} of {left.plan.program.total_time_s:.1f} s"),
        *([("uncertain by", f"{figures['uncertainty_s']:.2f} s")] if left.uncertainty_samples else []),
        ("predicted at first", f"{first_nm:.3f} nm RMS"),
    ]
    print_lines([*lines, *plan_lines(figures), ("written", str(output))])
