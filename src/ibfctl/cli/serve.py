"""`ibfctl serve`: the REST service."""

from __future__ import annotations

import ipaddress
import socket
from pathlib import Path

import click

from ibfctl.cli.options import machine_option, speed_option
from ibfctl.errors import InputError
from ibfctl.machine.shipped import shipped_machine


@click.command(name="serve")
@click.option("--simulate", is_flag=True, help="Stream runs to emulated controllers instead of the machine's own.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Loopback address to listen on.")
@click.option("--port", type=click.IntRange(0, 65535), default=8000, show_default=True, help="TCP port; 0: any.")
@click.option(
    "--data",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for all data; default: in the user's state folder.",
)
@machine_option(required=False)
@speed_option(1.0)
def command(simulate: bool, host: str, port: int, data: Path | None, machine: Path | None, speed: float) -> None:
    """Serve maps, plans and runs over REST, to this computer alone."""
    if machine is None:
        if not simulate:
            raise InputError("serve: no machine is given", "give --machine FILE, or --simulate")
        machine = shipped_machine("simulator")
    listener = _listen(host, port)
    try:
        import uvicorn

        from ibfctl.machine.description import read_machine
        from ibfctl.service.app import create_app
        from ibfctl.service.settings import Settings, default_data_folder

        read_machine(machine)
        settings = Settings(data or default_data_folder(), machine.absolute(), simulate, speed)
        shown, bound = listener.getsockname()[:2]
        click.echo(f"serving on http://{shown}:{bound}, data in {settings.data}", err=True)
        config = uvicorn.Config(create_app(settings), log_level="warning", lifespan="on")
        uvicorn.Server(config).run(sockets=[listener])
    finally:
        listener.close()


def _listen(host: str, port: int) -> socket.socket:
    """Bind before anything is loaded, so that a port in use is told at once."""
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host)
    except ValueError as error:
        raise InputError(f"serve: {host!r} is no IP address", "give --host 127.0.0.1 or ::1") from error
    if not address.is_loopback:
        raise InputError(f"serve: {host} can be reached from other computers", "without keys only 127.0.0.1 is served")
    try:
        return socket.create_server(
            (str(address), port), family=socket.AF_INET6 if address.version == 6 else socket.AF_INET
        )
    except OSError as error:
        raise InputError(
            f"serve: port {port} on {host} cannot be used ({error.strerror})",
            "end what uses it, or give another --port",
        ) from error
