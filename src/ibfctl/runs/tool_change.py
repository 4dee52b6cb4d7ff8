"""Between two tools of a run: the gate is closed, nothing moves, and the run has let go of the machine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ibfctl.errors import CancelledError, EstoppedError
from ibfctl.runs.requests import Requests
from ibfctl.runs.sentinel import wanted_end
from ibfctl.runs.tools import Part, next_part

LOOK_S = 0.1


def await_tool(folder: Path, part: Part, requests: Requests, estop: Callable[[], None]) -> Part:
    """Wait until the tool after `part` is mounted; return it, planned for what is left by then.

    Parameters
    ----------
    folder
        Of the run.
    part
        The tool before, executed to its end.
    requests
        What operators want; `confirm` says that the tool is mounted and the machine knows where it is.
    estop
        Carries out an emergency stop.

    Raises
    ------
    RunError
        If somebody wants the run to end.
    InputError, LimitsError, SolverError, ControllerError
        If the next tool cannot be planned, or the emergency stop does not reach the controller.
    """
    following: Part | None = None
    while True:
        error = wanted_end(requests)
        if isinstance(error, EstoppedError):
            estop()
        if error is not None:
            raise error
        if following is None:
            try:
                following = next_part(folder, part, lambda: wanted_end(requests) is not None)
            except CancelledError:
                continue
        if requests.confirmed:
            requests.resume()  # a pause that came too late for the tool before
            return following
        requests.abort.wait(LOOK_S)
