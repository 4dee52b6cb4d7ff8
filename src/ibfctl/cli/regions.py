"""Regions as text: X0,X1,Y0,Y1, circle:X,Y,R, polygon:X,Y,X,Y,..., polygon:FILE, mask:FILE."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ibfctl.surface.regions import Region

_FORMS = "X0,X1,Y0,Y1, circle:X,Y,R, polygon:X,Y,X,Y,X,Y,... (mm), polygon:FILE or mask:FILE"


def region(ctx: click.Context, param: click.Parameter, value: str | None) -> Region | None:
    """Make a region from its text."""
    if value is None:
        return None
    from ibfctl.path.from_file import read_columns
    from ibfctl.surface.map import Rectangle
    from ibfctl.surface.regions import Circle, MaskFile, Polygon

    kind, colon, rest = value.partition(":")
    numbers = _numbers(rest if colon else value)
    match kind if colon else "rectangle", numbers:
        case "rectangle", (x0, x1, y0, y1):
            if not (x0 < x1 and y0 < y1):
                raise click.BadParameter(f"{value!r} is empty: X0 must be less than X1, Y0 less than Y1.", ctx, param)
            return Rectangle(x0, x1, y0, y1)
        case "circle", (x, y, radius):
            return Circle(x, y, radius)
        case "polygon", (_, _, _, _, _, _, *_) if len(numbers) % 2 == 0:
            return Polygon(tuple(zip(numbers[::2], numbers[1::2], strict=True)))
        case "polygon", () if rest:
            x_mm, y_mm = read_columns(Path(rest), ("x_mm", "y_mm"))
            return Polygon(tuple(zip(x_mm.tolist(), y_mm.tolist(), strict=True)))
        case "mask", _ if rest:
            return MaskFile(Path(rest))
    raise click.BadParameter(f"{value!r} is none of {_FORMS}.", ctx, param)


def _numbers(text: str) -> tuple[float, ...]:
    """Return the numbers of a list with commas; empty where it is none."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        return ()
