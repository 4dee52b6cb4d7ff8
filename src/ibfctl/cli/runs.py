"""`ibfctl runs`: runs in the service."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ibfctl.cli.options import Decorator
from ibfctl.cli.output import print_json, print_lines
from ibfctl.cli.remote import failed, show, show_list, the_run, with_client
from ibfctl.cli.watch import describe, watch
from ibfctl.errors import RunError

if TYPE_CHECKING:
    from ibfctl.client import Client
    from ibfctl.client.records import Recovered, Run

run_argument: Decorator = click.argument("identity", metavar="[ID]", required=False)


@click.group(name="runs")
def command() -> None:
    """Runs in the service; without an ID the one that is under way is meant."""


@command.command()
@click.argument("plan_id")
@click.option("--operator", help="Who starts it; default: the name of the key.")
@click.option("--watch/--no-watch", "watched", default=True, show_default=True, help="Show it until it is over.")
@with_client
def start(client: Client, plan_id: str, operator: str | None, watched: bool, as_json: bool) -> None:
    """Stream a plan to its machine. The run goes on when this command ends."""
    run = client.runs.start(plan_id, operator)
    if watched:
        click.echo(f"run {run['id']}", err=True)
        run = watch(client, run["id"])
    _end(run, as_json)


@command.command(name="list")
@with_client
def list_runs(client: Client, as_json: bool) -> None:
    """List all runs."""
    names = ("id", "created", "state", "plan_id", "operator", "figures.as_run_rms_nm")
    show_list(list(client.runs.list()), as_json, *names)


@command.command(name="show")
@run_argument
@with_client
def show_run(client: Client, identity: str | None, as_json: bool) -> None:
    """Show a run: its state and status, its figures, or what ended it."""
    _show(client.runs.show(the_run(client, identity)), as_json)


@command.command(name="watch")
@run_argument
@with_client
def watch_run(client: Client, identity: str | None, as_json: bool) -> None:
    """Show a run until it is over; the exit code says how it ended."""
    _end(watch(client, the_run(client, identity)), as_json)


@command.command()
@run_argument
@click.option("--now", is_flag=True, help="Close the gate at once instead of at the next end of a segment.")
@with_client
def pause(client: Client, identity: str | None, now: bool, as_json: bool) -> None:
    """Ramp to rest along the path, with the gate closed."""
    _told(client.runs.pause(the_run(client, identity), now=now), "pause", as_json)


@command.command()
@run_argument
@with_client
def resume(client: Client, identity: str | None, as_json: bool) -> None:
    """Go on after a pause."""
    _told(client.runs.resume(the_run(client, identity)), "resume", as_json)


@command.command()
@click.argument("identity", metavar="ID")
@with_client
def recover(client: Client, identity: str, as_json: bool) -> None:
    """Close the gate, and ask the controller again what a run has executed that did not end as planned."""
    _show(client.runs.recover(identity), as_json)


@command.command()
@run_argument
@with_client
def stop(client: Client, identity: str | None, as_json: bool) -> None:
    """Close the gate, decelerate to rest, end the run."""
    _told(client.runs.stop(the_run(client, identity)), "stop", as_json)


@command.command()
@run_argument
@with_client
def abort(client: Client, identity: str | None, as_json: bool) -> None:
    """Close the gate and stop all motion at once; `ibfctl abort` does it without a service."""
    _told(client.runs.abort(the_run(client, identity)), "abort", as_json)


@command.command()
@run_argument
@with_client
def estop(client: Client, identity: str | None, as_json: bool) -> None:
    """Abort, switch the motors off, and let nothing move until the controller's power was off."""
    _told(client.runs.estop(the_run(client, identity)), "estop", as_json)


@command.command()
@run_argument
@with_client
def confirm(client: Client, identity: str | None, as_json: bool) -> None:
    """Confirm what the run waits for, such as a change of the tool."""
    _told(client.runs.confirm(the_run(client, identity)), "confirm", as_json)


@command.command()
@click.argument("name")
@click.argument("value", type=float)
@click.option("--run", "identity", metavar="ID", help="Run; default: the one under way.")
@with_client
def interlock(client: Client, name: str, value: float, identity: str | None, as_json: bool) -> None:
    """Push the VALUE of the interlock NAME, e.g. a beam current."""
    _told(client.runs.interlock(the_run(client, identity), name, value), f"{name} {value:g}", as_json)


@command.command()
@click.argument("identity", metavar="ID")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), help="Folder for the run's files.")
@with_client
def report(client: Client, identity: str, out: Path | None, as_json: bool) -> None:
    """Show what a run has left, and write its files: the run, that of each tool, the residual as table and picture."""
    run = client.runs.show(identity)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        for name in run["links"].keys() - {"self"}:
            client.runs.download(identity, name, out / name)
    _show(run, as_json)


@command.command()
@click.argument("identity", metavar="ID")
@with_client
def delete(client: Client, identity: str, as_json: bool) -> None:
    """Delete the files of a run that is over; what it did stays in the journal."""
    client.runs.delete(identity)
    show({"id": identity}, as_json, "id")


def _told(run: Run, act: str, as_json: bool) -> None:
    if as_json:
        print_json(run)
    else:
        click.echo(f"told run {run['id']}: {act}")


def _end(run: Run, as_json: bool) -> None:
    """Show a run; one that ended otherwise than as planned ends the command with its exit code."""
    _show(run, as_json)
    if "error" in run:
        raise failed(run["error"], RunError)


def _show(run: Run, as_json: bool) -> None:
    if as_json:
        print_json(run)
        return
    lines = [("id", run["id"]), ("plan", run["plan_id"]), ("operator", run["operator"])]
    lines.append(("status", describe(run.get("status") or {"state": run["state"]})))
    if "recovered" in run:
        lines.append(("recovered", _recovered(run["recovered"])))
    lines += [(name.replace("_", " "), f"{value:.6g}") for name, value in run.get("figures", {}).items()]
    print_lines(lines)


def _recovered(found: Recovered) -> str:
    """Say in one line what is known of a run that its worker has not told the end of."""
    executed = " and ".join(f"{first} to {last}" for first, last in found.get("executed", [])) or "none"
    text = f"executed with the gate open: {executed} samples of the plan"
    if found.get("uncertainty_samples"):
        text += f", perhaps {found['uncertainty_samples']} more"
    if found["can_resume"]:
        return f"{text}; it can be resumed"
    return f"{text}; {found.get('why_not', '')}; {found.get('hint', '')}".rstrip("; ")
