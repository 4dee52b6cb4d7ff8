"""`ibfctl influences`: tool influence functions in the service."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from ibfctl.cli.remote import show, show_list, with_client

if TYPE_CHECKING:
    from ibfctl.client import Client

_FIGURES = ("figures.radius_mm", "figures.peak_rate_nm_s", "figures.volume_rate_nm_mm2_s")


@click.group(name="influences")
def command() -> None:
    """Tool influence functions in the service."""


@command.command()
@click.argument("spec", metavar="FILE|FORMULA")
@click.option("--pixel-mm", type=float, help="Pixel size, mm, where the file does not say it.")
@click.option("--unit", help="Unit of rates (nm/s, um/min, ...) where the file has none.")
@with_client
def add(client: Client, spec: str, pixel_mm: float | None, unit: str | None, as_json: bool) -> None:
    """Upload a file, or give gaussian:fwhm_mm=..,peak_nm_s=..,radius_mm=.."""
    show(client.influences.add(spec, pixel_mm=pixel_mm, unit=unit), as_json, "id", *_FIGURES)


@command.command(name="list")
@with_client
def list_influences(client: Client, as_json: bool) -> None:
    """List all influence functions."""
    show_list(list(client.influences.list()), as_json, "id", "created", *_FIGURES)


@command.command(name="show")
@click.argument("identity", metavar="ID")
@with_client
def show_influence(client: Client, identity: str, as_json: bool) -> None:
    """Show an influence function's figures."""
    show(client.influences.show(identity), as_json, "id", "created", "format", "formula", *_FIGURES)


@command.command()
@click.argument("identity", metavar="ID")
@with_client
def delete(client: Client, identity: str, as_json: bool) -> None:
    """Delete an influence function that no plan refers to."""
    client.influences.delete(identity)
    show({"id": identity}, as_json, "id")
