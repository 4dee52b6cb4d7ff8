"""`ibfctl maps`: surface maps in the service."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ibfctl.cli.remote import show, show_list, with_client

if TYPE_CHECKING:
    from ibfctl.client import Client

_FIGURES = ("figures.nx", "figures.ny", "figures.pixel_mm", "figures.rms_nm", "figures.pv_nm")


@click.group(name="maps")
def command() -> None:
    """Surface maps in the service."""


@command.command()
@click.argument("file", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option("--pixel-mm", type=float, help="Pixel size, mm, where the file does not say it.")
@click.option("--unit", help="Unit of heights (nm, um, m, ...) where the file has none.")
@click.option("--array", metavar="NAME", help="Array of a .mat file.")
@with_client
def add(client: Client, file: Path, pixel_mm: float | None, unit: str | None, array: str | None, as_json: bool) -> None:
    """Upload the map in FILE."""
    show(client.maps.add(file, pixel_mm=pixel_mm, unit=unit, array=array), as_json, "id", *_FIGURES)


@command.command(name="list")
@with_client
def list_maps(client: Client, as_json: bool) -> None:
    """List all maps."""
    show_list(list(client.maps.list()), as_json, "id", "created", *_FIGURES)


@command.command(name="show")
@click.argument("identity", metavar="ID")
@click.option("--preview", type=click.Path(path_type=Path), metavar="FILE.png", help="Write a picture of it.")
@with_client
def show_map(client: Client, identity: str, preview: Path | None, as_json: bool) -> None:
    """Show a map's figures."""
    record = client.maps.show(identity)
    if preview is not None:
        client.maps.download(identity, "preview.png", preview)
    show(record, as_json, "id", "created", "format", *_FIGURES)


@command.command()
@click.argument("identity", metavar="ID")
@with_client
def delete(client: Client, identity: str, as_json: bool) -> None:
    """Delete a map that no plan refers to."""
    client.maps.delete(identity)
    show({"id": identity}, as_json, "id")
