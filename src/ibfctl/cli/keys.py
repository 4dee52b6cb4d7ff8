"""`ibfctl keys`: who may ask the service for what. Works on the data folder itself, with or without a service."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from ibfctl.cli.options import data_option, json_option
from ibfctl.cli.output import print_json, print_table
from ibfctl.runs.journal import Journal
from ibfctl.runs.places import journal_path
from ibfctl.service.keys import Key, KeyRing, Role

_ROLES = [role.name.lower() for role in Role]


@click.group(name="keys")
def command() -> None:
    """Keys of the service in a data folder, with a role each: view, operate, admin."""


@command.command()
@click.argument("name")
@click.option("--role", type=click.Choice(_ROLES), default="view", show_default=True, help="What the key may do.")
@data_option
@json_option
def add(name: str, role: str, data: Path, as_json: bool) -> None:
    """Make a key for NAME and print its token, which is shown this once."""
    key, token = KeyRing(data).add(name, Role.named(role))
    _note("add", key, data)
    if as_json:
        print_json({**_shown(key), "token": token})
    else:
        click.echo(token)


@command.command(name="list")
@data_option
@json_option
def list_keys(data: Path, as_json: bool) -> None:
    """List all keys; their secrets are not kept."""
    keys = [_shown(key) for key in KeyRing(data).all_keys()]
    if as_json:
        print_json({"items": keys})
    else:
        print_table(keys, ("id", "role", "created", "name"))


@command.command()
@click.argument("name")
@data_option
@json_option
def remove(name: str, data: Path, as_json: bool) -> None:
    """Remove the key of a name or id; its holder is refused from the next request on."""
    key = KeyRing(data).remove(name)
    _note("remove", key, data)
    if as_json:
        print_json(_shown(key))
    else:
        click.echo(f"removed {key.name}")


def _note(act: str, key: Key, data: Path) -> None:
    """Put a change of the keys into the audit log."""
    with Journal.open(journal_path(data)) as journal:
        told = {"act": f"keys {act} {key.name}", "id": key.id, "role": key.role, "by": f"user {os.getuid()}"}
        journal.append(None, "act", told)


def _shown(key: Key) -> dict[str, Any]:
    return {"id": key.id, "name": key.name, "role": key.role, "created": key.created}
