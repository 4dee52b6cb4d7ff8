"""The beam gate: a digital output with a handle of its own, so that closing it waits for no stream."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence

from ibfctl.errors import ControllerError
from ibfctl.machine.description import BeamGate
from ibfctl_drivers.galil.codec import message_of, parse_integers
from ibfctl_drivers.galil.link import Link, RejectedError

ATTEMPTS = 3
STAMP = "gcls=gcls+((gcls=0)*TIME)"
"""Whoever closes the gate first since it was armed leaves the time; later ones leave it as it is."""


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
        self.stamp_command = STAMP
        # The shutter's thread could be about to open it: closed first, and surely closed once that has been halted.
        self.shut_commands = (self.close_command, "HX 1", self.close_command, STAMP)
        self.operand = f"@OUT[{gate.output}]"
        self._open_link = open_link
        self._lock = threading.Lock()
        self._link = open_link()

    def means_open(self, level: int) -> bool:
        """Whether a level of the output opens the beam."""
        return level == self._level_when_open

    def is_open(self) -> bool:
        """Read the output back from the controller."""
        with self._lock:
            return self._read()

    def numbers(self, operands: Sequence[str]) -> list[int]:
        """Ask over this handle, on a fresh one if need be."""
        with self._lock:
            self._connect()
            question = message_of(operands)
            return parse_integers(self._link.ask(question), len(operands), question)

    def tell_and_ask(self, command: str, operand: str) -> int:
        """Send a command and ask for a number in one packet; a handle that is dead is left to the next closing."""
        with self._lock:
            question = message_of([operand])
            return parse_integers(self._link.tell_and_ask(command, question), 1, question)[0]

    def close(self, then: str | None = None) -> None:
        """Close the gate and read it back, on fresh handles if need be; `then` follows once it reads closed.

        Raises
        ------
        ControllerError
            If the gate does not read closed after several attempts; somebody must close it by hand.
        """
        with self._lock:
            for _ in range(ATTEMPTS):
                try:
                    self._connect()
                    with contextlib.suppress(RejectedError):  # what reads back decides; a lost variable stamps nothing
                        self._link.pipeline([f"{line}\r".encode("ascii") for line in self.shut_commands])
                    if not self._read():
                        if then is not None:
                            self._link.tell(then)
                        return
                    trouble = ControllerError("the output still reads open")
                except ControllerError as error:
                    trouble = error
        raise ControllerError(
            f"the beam gate could not be closed: {trouble.message}", "switch the beam off by hand now"
        ) from trouble

    def _connect(self) -> None:
        if not self._link.is_open:
            self._link = self._open_link()

    def _read(self) -> bool:
        question = message_of([self.operand])
        (level,) = parse_integers(self._link.ask(question), 1, question)
        return self.means_open(level)
