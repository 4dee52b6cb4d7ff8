"""Ending motion at once, on a handle that serves no other purpose, so that it waits for no lock and no queue."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ibfctl.errors import LinkError
from ibfctl_drivers.galil.gate import GateOutput
from ibfctl_drivers.galil.link import Link, RejectedError


class AbortLine:
    """Closes the gate and aborts.

    Parameters
    ----------
    gate
        Whose words close it; its handle is not used.
    open_link
        Opens a fresh handle; called at once, and again where the present one is dead.
    shared
        Whether the handle is that of everybody: then an abort breaks into what the others are doing on it.
    """

    def __init__(self, gate: GateOutput, open_link: Callable[[], Link], *, shared: bool) -> None:
        self._gate = gate
        self._open_link = open_link
        self._shared = shared
        self._link = open_link()

    def __call__(self, *after: str) -> None:
        """Close the gate and end all motion; the bytes leave before anything is waited for.

        Parameters
        ----------
        after
            Commands that follow.

        Raises
        ------
        ControllerError
            If it cannot be sent, or is refused.
        """
        # AB ends the thread that may open the gate; what was opened before it is closed behind it.
        close = self._gate.close_command
        lines = [close, "AB", close, *after, self._gate.stamp_command]
        try:
            self._shout(lines)
        except LinkError:
            self._link = self._open_link()
            self._shout(lines)

    def _shout(self, lines: Sequence[str]) -> None:
        data = "".join(f"{line}\r" for line in lines).encode("ascii")
        if self._shared:
            self._link.shout(b"\r" + data)
            self._link.abandon("an abort broke into it")
            return
        self._link.shout(data)
        *acts, _ = self._link.heard(prompts=len(lines))
        if not all(acts):  # the stamp, which is last, has no variable after a restart of the controller
            raise RejectedError("controller refused to abort", "use the emergency stop")
