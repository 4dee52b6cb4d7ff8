"""What verbs that talk to a service share: where it is, how a noun's commands are made, how records are shown."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import click

from ibfctl.cli.options import Decorator, json_option
from ibfctl.cli.output import print_json, print_lines, print_table
from ibfctl.errors import IbfctlError

if TYPE_CHECKING:
    from ibfctl.client import Client

DEFAULT_URL = "http://127.0.0.1:8000"
KEY_VARIABLE = "IBFCTL_KEY"

url_option: Decorator = click.option(
    "--url", envvar="IBFCTL_URL", default=DEFAULT_URL, show_default=True, help="Where the service is."
)


def with_client(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --url and --json, and call the command with an open client first."""

    @functools.wraps(command)
    def opened(*arguments: Any, url: str, **options: Any) -> Any:
        from ibfctl.client import Client

        with Client(url, os.environ.get(KEY_VARIABLE)) as client:
            return command(client, *arguments, **options)

    return url_option(json_option(opened))


def show(record: Mapping[str, Any], as_json: bool, *names: str) -> None:
    """Print a record: all of it as JSON, or some fields in lines; a name with dots is a field of a field."""
    if as_json:
        print_json(record)
        return
    values = [(name.rpartition(".")[2].replace("_", " "), _field(record, name)) for name in names]
    print_lines([(name, _text(value)) for name, value in values if value is not None])


def show_list(records: list[Any], as_json: bool, *names: str) -> None:
    """Print records: as JSON, or some fields in a table."""
    if as_json:
        print_json({"items": records})
        return
    rows = [{name.rpartition(".")[2]: _text(_field(record, name)) for name in names} for record in records]
    print_table(rows, [name.rpartition(".")[2] for name in names])


def failed(problem: Mapping[str, Any], otherwise: type[IbfctlError] = IbfctlError) -> IbfctlError:
    """Return the error of a problem, with the exit code of its kind, or of another where it has none."""
    kinds = {kind.code: kind for kind in _below(IbfctlError)}
    return kinds.get(problem["code"], otherwise)(problem["detail"], problem["hint"])


def the_run(client: Client, identity: str | None) -> str:
    """Return the run that is meant: the one that is given, or the only one under way."""
    if identity is not None:
        return identity
    running = client.info()["running"]
    if len(running) != 1:
        state = f"{len(running)} runs are under way" if running else "nothing runs"
        raise click.UsageError(f"{state}: name the run; `ibfctl runs list` shows all.")
    only: str = running[0]
    return only


def _below(kind: type[IbfctlError]) -> list[type[IbfctlError]]:
    return [kind, *(lower for child in kind.__subclasses__() for lower in _below(child))]


def _field(record: Mapping[str, Any], name: str) -> Any:
    value: Any = record
    for part in name.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else str(value)
