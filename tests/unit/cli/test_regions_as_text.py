"""The texts that --clear-aperture takes."""

from __future__ import annotations

from pathlib import Path

import click
import pytest

from ibfctl.cli.regions import region
from ibfctl.surface.map import Rectangle
from ibfctl.surface.regions import Circle, MaskFile, Polygon

CONTEXT, PARAMETER = click.Context(click.Command("plan")), click.Option(["--clear-aperture"])


@pytest.mark.parametrize(
    ("text", "made"),
    [
        ("-5,5.5,-3,1e1", Rectangle(-5, 5.5, -3, 10)),
        ("circle:1,-2,3.5", Circle(1, -2, 3.5)),
        ("polygon:0,0,4,0,2,3", Polygon(((0, 0), (4, 0), (2, 3)))),
        ("mask:some/mask.npy", MaskFile(Path("some/mask.npy"))),
        ("mask:1", MaskFile(Path("1"))),
    ],
)
def test_each_form_makes_its_region(text: str, made: object) -> None:
    assert region(CONTEXT, PARAMETER, text) == made


def test_a_polygon_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "corners.csv"
    file.write_text("x_mm,y_mm\n0,0\n4,0\n2,3\n")
    assert region(CONTEXT, PARAMETER, f"polygon:{file}") == Polygon(((0, 0), (4, 0), (2, 3)))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "1,2",
        "1,2,3,x",
        "circle:1,2",
        "circle:",
        "polygon:",
        "polygon:1,2,3,4",
        "polygon:1,2,3,4,5,6,7",
        "mask:",
        "disc:1,2,3",
    ],
)
def test_what_is_none_of_them_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter, match="is none of"):
        region(CONTEXT, PARAMETER, text)


def test_an_empty_rectangle_is_refused() -> None:
    with pytest.raises(click.BadParameter, match="empty"):
        region(CONTEXT, PARAMETER, "5,-5,0,1")
