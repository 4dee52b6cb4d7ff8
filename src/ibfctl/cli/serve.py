"""`ibfctl serve`: the REST service."""

from __future__ import annotations

import ipaddress
import socket
from pathlib import Path
from typing import Any

import click

from ibfctl.cli.options import POSITIVE, json_option
from ibfctl.cli.output import print_json
from ibfctl.errors import InputError

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.command(name="serve")
@click.option("--config", type=_FILE, help="TOML file with these settings; options come before it.")
@click.option("--simulate", is_flag=True, default=None, help="Stream runs to an emulated controller.")
@click.option("--host", help="Address to listen on; default: 127.0.0.1. Any other needs keys.")
@click.option("--port", type=click.IntRange(0, 65535), help="TCP port; 0: any; default: 8000.")
@click.option(
    "--data",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for all data; default: in the user's state folder.",
)
@click.option("--machine", metavar="FILE", help="Machine file, or the name of a shipped one: nsls2-ibf, simulator.")
@click.option(
    "--speed",
    type=POSITIVE,
    help="Clock of the emulated controller: its seconds per second; default: 1.",
)
@click.option("--tls-certificate", type=_FILE, help="Certificate chain (PEM): serve HTTPS.")
@click.option("--tls-key", type=_FILE, help="The certificate's key (PEM).")
@json_option
def command(config: Path | None, as_json: bool, **options: Any) -> None:
    """Serve maps, plans and runs over REST: to this computer alone, or by keys."""
    from ibfctl.service.config import read_config
    from ibfctl.service.sole import sole_service

    told = read_config(config, {name: value for name, value in options.items() if value is not None})
    settings = told.settings()
    with _listen(told.host, told.port, has_keys=_has_keys(settings.data)) as listener, sole_service(settings.data):
        from ibfctl.machine.description import read_machine
        from ibfctl.runs.promptness import ready_to_answer_soon
        from ibfctl.service.app import create_app
        from ibfctl.service.server import Server

        read_machine(settings.machine)
        shown, bound = listener.getsockname()[:2]
        scheme = "http" if told.tls_certificate is None else "https"
        url = f"{scheme}://{shown}:{bound}"
        click.echo(f"serving on {url}, data in {settings.data}", err=True)
        if as_json:
            print_json({"url": url, "data": str(settings.data)})
        app = create_app(settings)
        app.openapi()  # every request is checked against it
        ready_to_answer_soon()
        tls = [None if path is None else str(path) for path in (told.tls_certificate, told.tls_key)]
        Server(app, *tls).run(sockets=[listener])


def _has_keys(data: Path) -> bool:
    from ibfctl.service.keys import KeyRing

    return bool(KeyRing(data).all_keys())


def _listen(host: str, port: int, *, has_keys: bool) -> socket.socket:
    """Bind before anything is loaded, so that a port in use is told at once."""
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host)
    except ValueError as error:
        raise InputError(f"serve: {host!r} is no IP address", "give --host 127.0.0.1 or ::1") from error
    if not address.is_loopback and not has_keys:
        raise InputError(
            f"serve: {host} can be reached from other computers, and there are no keys", "`ibfctl keys add` makes one"
        )
    try:
        family = socket.AF_INET6 if address.version == 6 else socket.AF_INET
        listener = socket.create_server((str(address), port), family=family)
    except OSError as error:
        raise InputError(
            f"serve: port {port} on {host} cannot be used ({error.strerror})",
            "end what uses it, or give another --port",
        ) from error
    # Inherited by every connection; asyncio sets it only on sockets that it made itself. Without it the second
    # packet of every answer waits 40 ms for an acknowledgement.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener
