"""Options of a plan with several tools: `--tool TIF[:machine=FILE,pitch-mm=..,step-mm=..]`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ibfctl.cli.options import NOT_NEGATIVE, machine_path, together

if TYPE_CHECKING:
    from ibfctl.jobs.tool_files import ToolFile

_KEYS = ("machine", "pitch-mm", "step-mm", "path", "scan-axis")
METHODS = ("ours", "mto", "sto")


@dataclass(frozen=True)
class ToolSpec:
    """A tool as the user wrote it: its TIF, and choices by key."""

    influence: str
    choices: dict[str, str]

    def length_mm(self, key: str) -> float | None:
        """Return a positive length that was chosen, None where it was not.

        Raises
        ------
        click.UsageError
            If it is no positive number.
        """
        if key not in self.choices:
            return None
        try:
            value = float(self.choices[key])
        except ValueError:
            value = 0.0
        if not 0 < value < float("inf"):
            raise click.UsageError(f"{self.influence}: {key}={self.choices[key]} is no positive length in mm.")
        return value


def parse_tool(text: str) -> ToolSpec:
    """Split the choices from a TIF, which may hold colons and commas of its own.

    Raises
    ------
    click.BadParameter
        If a choice has no value or is given twice.
    """
    influence, colon, tail = text.rpartition(":")
    parts = [part.partition("=") for part in tail.split(",")]
    if not colon or not any(key in _KEYS for key, _, _ in parts):
        return ToolSpec(text, {})
    choices: dict[str, str] = {}
    for key, _, value in parts:
        if key not in _KEYS or not value or key in choices:
            raise click.BadParameter(
                f"{key!r} in {tail!r}: give each of {', '.join(_KEYS)} once at most, with a value."
            )
        choices[key] = value
    return ToolSpec(influence, choices)


def _tools(ctx: click.Context, param: click.Parameter, values: Sequence[str]) -> tuple[ToolSpec, ...]:
    return tuple(parse_tool(value) for value in values)


tool_change_option = click.option(
    "--tool-change-s",
    type=NOT_NEGATIVE,
    default=0.0,
    show_default=True,
    help="Time of a change of tools, s; counts in the total time.",
)
tools_argument = click.argument("tools", metavar="TIF[:KEY=VALUE,...]...", nargs=-1, required=True, callback=_tools)
tool_options = together(
    click.option(
        "--tool",
        "tools",
        multiple=True,
        metavar="TIF[:KEY=VALUE,...]",
        callback=_tools,
        help=f"A tool, in place of TIF; repeat it for several. Keys: {', '.join(_KEYS)}.",
    ),
    click.option(
        "--method",
        type=click.Choice(METHODS),
        default="ours",
        show_default=True,
        help="Dwell times of several tools: ours, or those of Ke et al. 2022, all at once or one after the other.",
    ),
    tool_change_option,
)


def tool_files(
    tools: Sequence[ToolSpec], machine: Path | None, pixel_mm: float | None, unit: str | None
) -> list[ToolFile]:
    """Make files of what the user wrote; a tool without a machine of its own has `machine`, if that.

    Raises
    ------
    click.UsageError
        If a choice is no length or no axis.
    """
    from ibfctl.jobs.inputs import InfluenceFile
    from ibfctl.jobs.tool_files import ToolFile

    files = []
    for tool in tools:
        if tool.choices.get("scan-axis", "x") not in ("x", "y"):
            raise click.UsageError(f"{tool.influence}: scan-axis={tool.choices['scan-axis']} is neither x nor y.")
        files.append(
            ToolFile(
                InfluenceFile(tool.influence, pixel_mm, unit),
                machine_path(tool.choices.get("machine")) or machine,
                tool.length_mm("pitch-mm"),
                tool.length_mm("step-mm"),
                tool.choices.get("path"),
                tool.choices.get("scan-axis"),
            )
        )
    return files
