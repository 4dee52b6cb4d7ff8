"""Options that several verbs share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ibfctl.machine.shipped import shipped_machine

if TYPE_CHECKING:
    from ibfctl.surface.map import Rectangle

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def corners(ctx: click.Context, param: click.Parameter, value: str | None) -> Rectangle | None:
    """Make a rectangle from the text X0,X1,Y0,Y1."""
    if value is None:
        return None
    try:
        x0, x1, y0, y1 = (float(part) for part in value.split(","))
    except ValueError as error:
        raise click.BadParameter(f"{value!r} is not four numbers X0,X1,Y0,Y1 in mm.", ctx, param) from error
    if not (x0 < x1 and y0 < y1):
        raise click.BadParameter(f"{value!r} is empty: X0 must be less than X1, Y0 less than Y1.", ctx, param)
    from ibfctl.surface.map import Rectangle

    return Rectangle(x0, x1, y0, y1)


def _machine_path(ctx: click.Context, param: click.Parameter, value: str | None) -> Path | None:
    """Take a path, or the bare name of a machine file that comes with the package."""
    if value is None:
        return None
    path = Path(value)
    return shipped_machine(value) if path.suffix == "" and path.name == value and not path.is_file() else path


def machine_option(*, required: bool) -> Decorator:
    """Return the option --machine."""
    return click.option(
        "--machine",
        required=required,
        metavar="FILE",
        callback=_machine_path,
        help="Machine file, or the name of a shipped one: nsls2-ibf, simulator.",
    )


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


json_option: Decorator = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")


def speed_option(default: float) -> Decorator:
    """Return the option --speed of an emulated controller."""
    return click.option(
        "--speed",
        type=click.FloatRange(min=0, min_open=True),
        default=default,
        show_default=True,
        help="Clock of the emulated controller: its seconds per second.",
    )
