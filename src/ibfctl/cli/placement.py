"""Options that say how the part stands on the machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ibfctl.cli.options import POSITIVE, together

if TYPE_CHECKING:
    from ibfctl.machine.placement import Placement

_COLUMNS = ("part_x_mm", "part_y_mm", "machine_x_mm", "machine_y_mm")


def _offset(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[float, float] | None:
    """Take the text X,Y."""
    if value is None:
        return None
    try:
        x_mm, y_mm = (float(part) for part in value.split(","))
    except ValueError as error:
        raise click.BadParameter(f"{value!r} is not two numbers X,Y in mm.", ctx, param) from error
    return x_mm, y_mm


placement_options = together(
    click.option("--offset-mm", metavar="X,Y", callback=_offset, help="Part's origin on the machine; default: 0,0."),
    click.option("--rotation-deg", type=float, help="Rotation of the part, counterclockwise; default: 0."),
    click.option("--mirror", is_flag=True, help="The part's x counts against the machine's, before the rotation."),
    click.option(
        "--fiducials",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Pairs to fit offset and rotation to: part_x_mm,part_y_mm,machine_x_mm,machine_y_mm.",
    ),
    click.option(
        "--fiducial-limit-mm", type=POSITIVE, default=0.05, show_default=True, help="Largest error of a fiducial, mm."
    ),
)


def placed(choices: dict[str, Any]) -> dict[str, Any]:
    """Replace the values of `placement_options` among the choices by one `placement`."""
    names = ("offset_mm", "rotation_deg", "mirror", "fiducials", "fiducial_limit_mm")
    given = {name: choices[name] for name in names}
    kept = {name: value for name, value in choices.items() if name not in names}
    return {**kept, "placement": _placement(**given)}


def _placement(
    offset_mm: tuple[float, float] | None,
    rotation_deg: float | None,
    mirror: bool,
    fiducials: Path | None,
    fiducial_limit_mm: float,
) -> Placement:
    from ibfctl.machine.placement import Placement, fit_placement

    if fiducials is None:
        return Placement(*(offset_mm or (0.0, 0.0)), rotation_deg or 0.0, mirror)
    if offset_mm is not None or rotation_deg is not None:
        raise click.UsageError("--fiducials fixes what --offset-mm and --rotation-deg say.")
    import numpy as np

    from ibfctl.path.from_file import read_columns

    part_x, part_y, machine_x, machine_y = read_columns(fiducials, _COLUMNS)
    return fit_placement(
        np.column_stack([part_x, part_y]),
        np.column_stack([machine_x, machine_y]),
        mirrored=mirror,
        limit_mm=fiducial_limit_mm,
    )
