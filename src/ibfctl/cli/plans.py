"""`ibfctl plans`: plans in the service."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ibfctl.cli.options import Decorator
from ibfctl.cli.output import check_writable, print_json, print_lines
from ibfctl.cli.progress import progress
from ibfctl.cli.remote import failed, show, show_list, with_client
from ibfctl.cli.tool_options import ToolSpec, tool_options
from ibfctl.cli.words import plan_lines, tool_table

if TYPE_CHECKING:
    from ibfctl.client import Client
    from ibfctl.client.records import Plan

_FILES = ("plan.h5", "plan.csv", "plan.pvt.csv", "plan.pvt.dmc", "plan.gcode", "dwell.npz", "residual.npz")
_FORMATS: dict[str, str] = {name.removeprefix("plan.").removesuffix(".npz"): name for name in _FILES}


def _settings(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> dict[str, Any]:
    """Make options of the texts KEY=VALUE; a value that is no JSON is a text."""
    options = {}
    for text in value:
        name, separator, given = text.partition("=")
        if not separator:
            raise click.BadParameter(f"{text!r} is not KEY=VALUE.", ctx, param)
        try:
            options[name] = json.loads(given)
        except ValueError:
            options[name] = given
    return options


set_option: Decorator = click.option(
    "--set", "options", metavar="KEY=VALUE", multiple=True, callback=_settings, help="Option, as in docs/rest.md."
)


@click.group(name="plans")
def command() -> None:
    """Plans in the service."""


@command.command()
@click.argument("map_id")
@click.argument("influence_id", required=False)
@click.option("--machine", metavar="ID", help="Machine to plan for; default: the service's own.")
@tool_options
@set_option
@click.option("--wait/--no-wait", default=True, show_default=True, help="Wait for the result.")
@with_client
def create(
    client: Client,
    map_id: str,
    influence_id: str | None,
    machine: str | None,
    tools: tuple[ToolSpec, ...],
    method: str,
    tool_change_s: float,
    options: dict[str, Any],
    wait: bool,
    as_json: bool,
) -> None:
    """Plan MAP_ID with INFLUENCE_ID, e.g. with --set pitch_mm=1 --set path=maze.

    Instead of INFLUENCE_ID, --tool may name several, used one after the other: TIF and a machine are ids here.
    """
    if (influence_id is None) == (not tools):
        raise click.UsageError("Give either INFLUENCE_ID or --tool.")
    given: dict[str, Any] = {"machine_id": machine} if machine else {}
    if tools:
        given |= {"tools": [_tool(tool) for tool in tools], "method": method, "tool_change_s": tool_change_s}
    plan = client.plans.create(map_id, influence_id, **options, **given)
    if wait:
        with progress() as report:
            plan = client.plans.wait(plan["id"], lambda told: report(told["stage"], told["fraction"]))
    if "error" in plan:
        raise failed(plan["error"])
    _show(plan, as_json)


@command.command()
@click.argument("path", metavar="PLAN.h5", type=click.Path(path_type=Path, dir_okay=False, exists=True))
@click.option("--machine", metavar="ID", help="Machine that runs it; default: the service's own.")
@with_client
def add(client: Client, path: Path, machine: str | None, as_json: bool) -> None:
    """Bring a plan that was made elsewhere, e.g. that of `ibfctl replan` for the rest of a run."""
    _show(client.plans.add(path, machine), as_json)


@command.command(name="list")
@with_client
def list_plans(client: Client, as_json: bool) -> None:
    """List all plans."""
    names = ("id", "created", "state", "summary.executed_rms_nm", "summary.total_time_s")
    show_list(list(client.plans.list()), as_json, *names)


@command.command(name="show")
@click.argument("identity", metavar="ID")
@with_client
def show_plan(client: Client, identity: str, as_json: bool) -> None:
    """Show a plan: how far it is, its figures, or why it failed."""
    _show(client.plans.show(identity), as_json)


@command.command()
@click.argument("identity", metavar="ID")
@click.option(
    "--format", "form", type=click.Choice(list(_FORMATS)), default="h5", show_default=True, help="What to write."
)
@click.option("--tool", type=click.IntRange(min=1), help="Of several tools this one, from one, in their order.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="File to write; default: beside you.")
@with_client
def export(
    client: Client, identity: str, form: str, tool: int | None, output: Path | None, as_json: bool
) -> None:
    """Write a file of a plan: the plan itself, or an export for Galil's tools."""
    from ibfctl.jobs.plan_artefacts import of_tool

    name = _FORMATS[form] if tool is None else of_tool(_FORMATS[form], tool)
    path = output or Path(name)
    check_writable(path)
    client.plans.download(identity, name, path)
    show({"written": str(path)}, as_json, "written")


@command.command()
@click.argument("identity", metavar="ID")
@with_client
def cancel(client: Client, identity: str, as_json: bool) -> None:
    """Cancel the planning."""
    show(client.plans.cancel(identity), as_json, "id", "state")


@command.command()
@click.argument("identity", metavar="ID")
@with_client
def delete(client: Client, identity: str, as_json: bool) -> None:
    """Delete a plan that is over and that no run refers to."""
    client.plans.delete(identity)
    show({"id": identity}, as_json, "id")


def _tool(tool: ToolSpec) -> dict[str, Any]:
    """Make what the service is told of a tool."""
    lengths = {key: tool.length_mm(key) for key in ("pitch-mm", "step-mm") if key in tool.choices}
    choices = {"machine_id" if key == "machine" else key: value for key, value in (tool.choices | lengths).items()}
    return {"influence_id": tool.influence, **{key.replace("-", "_"): value for key, value in choices.items()}}


def _show(plan: Plan, as_json: bool) -> None:
    if as_json:
        print_json(plan)
        return
    lines = [("id", plan["id"]), ("state", plan["state"])]
    if "summary" in plan:
        lines += plan_lines(plan["summary"])
    if "progress" in plan:
        lines.append(("progress", f"{plan['progress']['stage']} {plan['progress']['fraction']:.0%}"))
    if "error" in plan:
        lines.append(("error", f"{plan['error']['detail']}; {plan['error']['hint']}"))
    print_lines(lines)
    if "tools" in plan.get("summary", {}):
        click.echo("\n".join(tool_table(plan["summary"])))
