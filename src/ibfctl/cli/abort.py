"""`ibfctl abort`: abort whatever the service runs."""

from __future__ import annotations

import http.client
import json
from typing import Any

import click

from ibfctl.errors import ControllerError

_TIMEOUT_S = 5.0


@click.command(name="abort")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address of the service.")
@click.option("--port", type=click.IntRange(1, 65535), default=8000, show_default=True, help="Its TCP port.")
def command(host: str, port: int) -> None:
    """Close the beam gate and stop all motion of every run that the service has under way."""
    service = http.client.HTTPConnection(host, port, timeout=_TIMEOUT_S)
    try:
        runs = _ask(service, "GET", "/v1/info")["running"]
        for identity in runs:
            _ask(service, "POST", f"/v1/runs/{identity}/abort")
    except (OSError, http.client.HTTPException, ValueError, KeyError) as error:
        raise ControllerError(
            f"abort: no service answers on {host}:{port} ({error})", "use the machine's own stop"
        ) from error
    finally:
        service.close()
    click.echo(f"aborted  {', '.join(runs)}" if runs else "nothing runs")


def _ask(service: http.client.HTTPConnection, method: str, place: str) -> Any:
    service.request(method, place)
    answer = service.getresponse()
    content = answer.read()
    if answer.status >= http.HTTPStatus.BAD_REQUEST:
        raise ControllerError(f"abort: {method} {place} was refused ({answer.status})", "use the machine's own stop")
    return json.loads(content)
