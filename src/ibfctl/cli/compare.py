"""`ibfctl compare`: schedulers, or methods for dwell times, side by side on the same paths."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ibfctl.cli.options import POSITIVE, bounds_options, covering_options, json_option, machine_option, unit_options
from ibfctl.cli.output import print_json
from ibfctl.cli.placement import placed, placement_options
from ibfctl.cli.progress import progress
from ibfctl.cli.words import comparison_lines, method_lines

if TYPE_CHECKING:
    from ibfctl.planning.options import MadePath

_KINDS = ("raster", "maze", "random", "spiral")


@click.command(name="compare")
@click.argument("surface_map", metavar="MAP")
@click.argument("influence", metavar="TIF")
@machine_option(required=True)
@click.option("--methods", is_flag=True, help="Compare methods for dwell times instead of schedulers.")
@click.option(
    "--path",
    "kinds",
    type=click.Choice(_KINDS),
    multiple=True,
    default=_KINDS[:3],
    show_default=True,
    help="Path to compare on, may be repeated; a raster along x and along y.",
)
@covering_options
@placement_options
@bounds_options
@click.option(
    "--jerk-max-mm-s3",
    type=POSITIVE,
    help="Compare also PVT with this limit of the jerk, mm/s³.",
)
@unit_options
@json_option
def command(
    surface_map: str,
    influence: str,
    machine: Path,
    methods: bool,
    kinds: tuple[MadePath, ...],
    jerk_max_mm_s3: float | None,
    map_pixel_mm: float | None,
    map_unit: str | None,
    map_array: str | None,
    tif_pixel_mm: float | None,
    tif_unit: str | None,
    as_json: bool,
    **choices: Any,
) -> None:
    """Compare schedulers: PVT with and without motion in the loop, constant acceleration, position mode.

    All but the classic chain get the same dwell times on a path; what each leaves is computed from its own motion.
    With --methods, methods for dwell times instead, all executed through the same scheduler: inverse filter, NNLS,
    damped LSMR, and ours. MAP and TIF are as for `ibfctl plan`. Nothing is written, and the baselines are never sent
    to a machine.
    """
    if methods and jerk_max_mm_s3 is not None:
        raise click.UsageError("--jerk-max-mm-s3 is for comparing schedulers, not --methods.")
    from ibfctl.jobs.inputs import InfluenceFile, MapFile
    from ibfctl.machine.description import read_machine
    from ibfctl.planning import comparison, side_by_side
    from ibfctl.planning.options import PlanOptions

    paths = comparison.path_choices(kinds, PlanOptions(**placed(choices)))
    surface = MapFile(surface_map, map_pixel_mm, map_unit, map_array).read()
    tool = InfluenceFile(influence, tif_pixel_mm, tif_unit).read()
    stages = read_machine(machine)
    with progress() as report:
        if methods:
            figures = side_by_side.summary(side_by_side.compare_methods(surface, tool, stages, paths, progress=report))
        else:
            figures = comparison.summary(
                comparison.compare(surface, tool, stages, paths, jerk_max_mm_s3=jerk_max_mm_s3, progress=report)
            )
    if as_json:
        print_json(figures)
    else:
        click.echo("\n".join(method_lines(figures) if methods else comparison_lines(figures)))
