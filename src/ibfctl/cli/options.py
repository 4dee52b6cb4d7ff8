"""Options that several verbs share."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from ibfctl.cli.regions import region
from ibfctl.files import state_folder
from ibfctl.machine.shipped import machine_file

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


class Finite(click.FloatRange):
    """A number within a range; a comparison alone lets NaN pass, and a range without an upper end infinity."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Refuse what is no finite number."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{number} is not a finite number.", param, ctx)
        return number


POSITIVE = Finite(min=0, min_open=True)
NOT_NEGATIVE = Finite(min=0)


def machine_path(value: str | None) -> Path | None:
    """Take a path, or the bare name of a machine file that comes with the package."""
    return None if value is None else machine_file(value)


def machine_option(*, required: bool) -> Decorator:
    """Return the option --machine."""
    return click.option(
        "--machine",
        required=required,
        metavar="FILE",
        callback=lambda ctx, param, value: machine_path(value),
        help="Machine file, or the name of a shipped one: nsls2-ibf, simulator.",
    )


def _terms(ctx: click.Context, param: click.Parameter, value: str) -> str:
    """Refuse what names no terms before anything is read."""
    from ibfctl.surface.terms import check_terms

    check_terms(value)
    return value


def output_option(default: str) -> Decorator:
    """Return the option -o with its default name."""
    return click.option(
        "-o",
        "--output",
        type=click.Path(path_type=Path),
        default=default,
        show_default=True,
        help="File to write.",
    )


def together(*options: Decorator) -> Decorator:
    """Make one decorator of several options, in the order of the help."""

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


# Named as the fields of `PlanOptions`.
covering_options = together(
    click.option(
        "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of a random path or maze."
    ),
    click.option("--inside-out", is_flag=True, help="A spiral starts in the middle."),
    click.option(
        "--pitch-mm", type=float, help="Distance between lines, mm; default: a quarter of the tool's full width."
    ),
    click.option("--step-mm", type=float, help="Distance between nodes on a line, mm; default: the pitch."),
    click.option(
        "--clear-aperture",
        metavar="REGION",
        callback=region,
        help="Where the residual counts: X0,X1,Y0,Y1, circle:X,Y,R, polygon:X,Y,X,Y,... in mm, polygon:FILE or "
        "mask:FILE; default: the whole map.",
    ),
    click.option(
        "--remove",
        metavar="TERMS",
        callback=_terms,
        default="tilt",
        show_default=True,
        help="Free terms: none, piston, tilt (with piston), power (with tilt), legendre:N or zernike:N.",
    ),
    click.option(
        "--extra-removal-nm", type=POSITIVE, help="Depth that every place must lose, nm; nothing is free then."
    ),
    click.option(
        "--corridor-mm", type=float, help="How far the path may leave its segment, mm; default: 5 % of pitch."
    ),
    click.option(
        "--corner-tolerance-mm",
        type=POSITIVE,
        help="Round corners, leaving the programmed path by no more, mm; default: sharp.",
    ),
)

bounds_options = together(
    click.option("--dwell-min-s", type=float, help="Lower bound of every dwell time, s; default: the machine's own."),
    click.option(
        "--v-min-mm-s",
        type=POSITIVE,
        help="Slowest mean speed over a step, mm/s: an upper bound of every dwell time.",
    ),
    click.option(
        "--dwell-bounds",
        type=click.Choice(["machine", "ramp"]),
        default="machine",
        show_default=True,
        help="Shortest times of the machine, or also the bounds of linear ramps.",
    ),
)

unit_options = together(
    click.option("--map-pixel-mm", type=float, help="Pixel size of MAP, mm, where the file does not say it."),
    click.option("--map-unit", metavar="UNIT", help="Unit of heights (nm, um, m, ...) where the file has none."),
    click.option("--map-array", metavar="NAME", help="Array of a .mat or HDF5 MAP; default: Z_to_remove, else Z."),
    click.option("--tif-pixel-mm", type=float, help="Pixel size of TIF, mm, where the file does not say it."),
    click.option("--tif-unit", metavar="UNIT", help="Unit of rates (nm/s, um/min, ...) where the file has none."),
)

data_option: Decorator = click.option(
    "--data",
    type=click.Path(path_type=Path, file_okay=False),
    default=state_folder,
    show_default="in the user's state folder",
    help="The service's data folder.",
)

json_option: Decorator = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")


def speed_option(default: float) -> Decorator:
    """Return the option --speed of an emulated controller."""
    return click.option(
        "--speed",
        type=POSITIVE,
        default=default,
        show_default=True,
        help="Clock of the emulated controller: its seconds per second.",
    )
