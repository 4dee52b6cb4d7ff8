"""--tool: a TIF may hold colons and commas of its own."""

from __future__ import annotations

import click
import pytest

from ibfctl.cli.tool_options import ToolSpec, parse_tool

FORMULA = "gaussian:fwhm_mm=5,peak_nm_s=10,radius_mm=7.5"


@pytest.mark.parametrize("influence", ["tif.npz", "folder/my:tif.npz", FORMULA])
def test_choices_follow_the_last_colon(influence: str) -> None:
    assert parse_tool(influence) == ToolSpec(influence, {})
    spec = parse_tool(f"{influence}:machine=a.toml,pitch-mm=1.5,scan-axis=y")
    assert spec == ToolSpec(influence, {"machine": "a.toml", "pitch-mm": "1.5", "scan-axis": "y"})
    assert spec.length_mm("pitch-mm") == 1.5
    assert spec.length_mm("step-mm") is None


@pytest.mark.parametrize("choices", ["pitch-mm=1,pitch-mm=2", "machine=", "pitch-mm=1,colour=red", "pitch-mm"])
def test_what_is_no_choice_is_refused(choices: str) -> None:
    with pytest.raises(click.BadParameter, match="once at most"):
        parse_tool(f"{FORMULA}:{choices}")


@pytest.mark.parametrize("value", ["0", "-1", "wide", "nan", "inf"])
def test_a_length_is_positive(value: str) -> None:
    with pytest.raises(click.UsageError, match="no positive length"):
        parse_tool(f"tif.npz:step-mm={value}").length_mm("step-mm")
