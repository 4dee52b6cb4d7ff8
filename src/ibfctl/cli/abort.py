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
_PATIENCE_S, _LOOK_S = 5.0, 0.05
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
        hung = _still_moving(data, told)  # a service would see to those itself
        if hung:
            raise ControllerError(f"abort: {', '.join(hung)} was told and has not ended", _MACHINES_OWN) from error
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


def _still_moving(data: Path, told: set[str]) -> list[str]:
    """Return which runs of those told are not over after a time: what hangs takes an abort all the same."""
    import time

    from ibfctl.runs import status
    from ibfctl.runs.places import run_folder
    from ibfctl.runs.states import TERMINAL

    deadline = time.monotonic() + _PATIENCE_S
    runs = sorted(run for run in told if run_folder(data, run).is_dir())
    while runs and time.monotonic() < deadline:
        runs = [run for run in runs if (status.read(run_folder(data, run)) or {}).get("state") not in TERMINAL]
        time.sleep(_LOOK_S)
    return runs


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
