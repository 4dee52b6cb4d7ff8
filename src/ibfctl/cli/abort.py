"""`ibfctl abort`: abort whatever runs, whether a service answers or not.

The order is that of the shortest way: first the pipes of the workers in the data folder, which need nobody else, then
the service, which may be on another computer. Nothing is imported that is not needed before the first byte is written.
"""

from __future__ import annotations

import os
from pathlib import Path

import click

from ibfctl.cli.options import data_option, json_option
from ibfctl.errors import ControllerError, RunError
from ibfctl.runs.control import send

_TIMEOUT_S = 2.0
_MACHINES_OWN = "use the machine's own stop"


@click.command(name="abort")
@data_option
@click.option("--url", envvar="IBFCTL_URL", default="http://127.0.0.1:8000", show_default=True, help="The service.")
@json_option
def command(data: Path, url: str, as_json: bool) -> None:
    """Close the beam gate and stop all motion of everything that runs.

    Tells the workers in the data folder of this computer themselves, and then the service.
    """
    told = _tell_workers(data)
    try:
        told |= _tell_service(url)
    except ControllerError as error:
        if not told:
            raise ControllerError(f"abort: nothing runs in {data}, and {error.message}", _MACHINES_OWN) from error
    if as_json:
        from ibfctl.cli.output import print_json

        print_json({"aborted": sorted(told)})
    else:
        click.echo(f"aborted  {', '.join(sorted(told))}" if told else "nothing runs")


def _tell_workers(data: Path) -> set[str]:
    """Write to the pipe of every worker that lives; return what was told."""
    told = set()
    for pipe in [*data.glob("runs/*/control"), *data.glob("acts/*/control")]:
        try:
            send(pipe.parent, {"act": "abort", "key": None, "by": f"ibfctl abort, user {os.getuid()}"})
        except (RunError, OSError):  # it is over; or it is hung, and the service or the guard must do
            continue
        told.add(pipe.parent.name)
    return told


def _tell_service(url: str) -> set[str]:
    import http.client
    import json
    from urllib.parse import urlsplit

    kinds = {"http": http.client.HTTPConnection, "https": http.client.HTTPSConnection}
    try:
        parts = urlsplit(url)
        service = kinds[parts.scheme](parts.hostname or "", parts.port, timeout=_TIMEOUT_S)
    except (ValueError, KeyError, http.client.InvalidURL) as error:
        raise ControllerError(f"{url!r} is no address of a service", _MACHINES_OWN) from error
    key = os.environ.get("IBFCTL_KEY")
    try:
        service.request("POST", "/v1/abort", headers={"Authorization": f"Bearer {key}"} if key else {})
        answer = service.getresponse()
        content = answer.read()
        if answer.status >= http.client.BAD_REQUEST:
            raise ControllerError(f"the service at {url} refused ({answer.status} {answer.reason})", _MACHINES_OWN)
        return set(json.loads(content)["runs"])
    except (OSError, http.client.HTTPException, ValueError, KeyError, TypeError) as error:
        raise ControllerError(f"no service answers at {url} ({error})", _MACHINES_OWN) from error
    finally:
        service.close()
