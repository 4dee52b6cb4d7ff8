"""`ibfctl machines`: machine files in the service."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ibfctl.cli.remote import show, show_list, with_client

if TYPE_CHECKING:
    from ibfctl.client import Client

_FIELDS = ("machine.name", "machine.connection.driver", "machine.connection.host", "machine.connection.port")


@click.group(name="machines")
def command() -> None:
    """Machine files in the service: limits to plan for, and where runs are sent to."""


@command.command()
@click.argument("file", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@with_client
def add(client: Client, file: Path, as_json: bool) -> None:
    """Add the machine file FILE."""
    show(client.machines.add(file), as_json, "id", *_FIELDS)


@command.command(name="list")
@with_client
def list_machines(client: Client, as_json: bool) -> None:
    """List all machine files."""
    show_list(list(client.machines.list()), as_json, "id", "created", *_FIELDS)


@command.command(name="show")
@click.argument("identity", metavar="ID")
@with_client
def show_machine(client: Client, identity: str, as_json: bool) -> None:
    """Show a machine file."""
    show(client.machines.show(identity), as_json, "id", "created", *_FIELDS)


@command.command()
@click.argument("identity", metavar="ID")
@with_client
def delete(client: Client, identity: str, as_json: bool) -> None:
    """Delete a machine file that no plan refers to."""
    client.machines.delete(identity)
    show({"id": identity}, as_json, "id")
