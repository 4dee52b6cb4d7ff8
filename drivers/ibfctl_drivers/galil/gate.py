"""The beam gate: a digital output with a handle of its own, so that closing it waits for nothing else."""

from __future__ import annotations

import threading
from collections.abc import Callable

from ibfctl.errors import ControllerError
from ibfctl.machine.description import BeamGate
from ibfctl_drivers.galil.codec import message_of, parse_integers
from ibfctl_drivers.galil.link import Link

ATTEMPTS = 3


class GateOutput:
    """The output that opens the beam.

    Parameters
    ----------
    gate
        Number of the output and its sense.
    open_link
        Opens a fresh handle; called at once and again whenever the present handle is dead.
    """

    def __init__(self, gate: BeamGate, open_link: Callable[[], Link]) -> None:
        set_line, clear_line = f"SB {gate.output}", f"CB {gate.output}"
        opens_when_set = gate.open_when == "set"
        self.open_command = set_line if opens_when_set else clear_line
        self.close_command = clear_line if opens_when_set else set_line
        self._level_when_open = int(opens_when_set)
        self.closed_condition = f"@OUT[{gate.output}]={1 - self._level_when_open}"
        self._question = message_of([f"@OUT[{gate.output}]"])
        self._open_link = open_link
        self._lock = threading.Lock()
        self._link = open_link()

    def is_open(self) -> bool:
        """Read the output back from the controller."""
        with self._lock:
            return self._read()

    def close(self) -> None:
        """Close the gate and read it back, on fresh handles if need be.

        Raises
        ------
        ControllerError
            If the gate does not read closed after several attempts; somebody must close it by hand.
        """
        with self._lock:
            for _ in range(ATTEMPTS):
                try:
                    if not self._link.is_open:
                        self._link = self._open_link()
                    self._link.tell(self.close_command)
                    if not self._read():
                        return
                    trouble = ControllerError("the output still reads open")
                except ControllerError as error:
                    trouble = error
        raise ControllerError(
            f"the beam gate could not be closed: {trouble.message}", "switch the beam off by hand now"
        ) from trouble

    def disconnect(self) -> None:
        """Give the handle back; never raises."""
        self._link.close()

    def _read(self) -> bool:
        (level,) = parse_integers(self._link.ask(self._question), 1, self._question)
        return level == self._level_when_open
