"""`ibfctl events`: what happens in the service, as it happens."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

from ibfctl.cli.remote import with_client
from ibfctl.cli.watch import describe

if TYPE_CHECKING:
    from ibfctl.client import Client
    from ibfctl.client.records import Event


@click.command(name="events")
@click.option("--run", metavar="ID", help="Only what concerns this run.")
@click.option("--after", type=click.IntRange(min=0), metavar="EVENT", help="Replay the journal after this event first.")
@click.option("--follow/--no-follow", default=True, show_default=True, help="Go on with what comes.")
@click.option("--telemetry", is_flag=True, help="Show the status of runs as well, up to ten times a second.")
@with_client
def command(client: Client, run: str | None, after: int | None, follow: bool, telemetry: bool, as_json: bool) -> None:
    """Show events of the journal as they come; with --json each as one object in a line."""
    for event in client.events(run, after, follow=follow):
        if telemetry or event["id"] is not None:
            click.echo(json.dumps(event) if as_json else _line(event))


def _line(event: Event) -> str:
    told = event["data"]
    if event["event"] == "telemetry":
        return f"{told['at']}  {told['run']}  {describe(told)}"
    rest = {name: value for name, value in told.items() if name not in ("at", "run") and value is not None}
    shown = "  ".join(f"{name}={value}" for name, value in rest.items())
    return f"{told['at']}  {told['run'] or '-'}  {event['event']}  {shown}"
