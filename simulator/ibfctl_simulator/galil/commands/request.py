"""What a command handler is given and what it may answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from ibfctl_simulator.galil import arguments, errors
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.expressions import evaluate
from ibfctl_simulator.galil.handles import Handles
from ibfctl_simulator.galil.operands import ControllerValues
from ibfctl_simulator.galil.programs.engine import Engine
from ibfctl_simulator.galil.programs.thread import Thread, Wait
from ibfctl_simulator.galil.record import RecordPusher
from ibfctl_simulator.galil.state import State


@dataclass(frozen=True)
class Download:
    """The client's next lines are a program, up to a backslash."""


class Request(NamedTuple):
    """One command: the text behind its two letters, where it came from, and what it acts on.

    Attributes
    ----------
    values
        What expressions can name.
    handle
        Letter of the Ethernet handle that sent it; empty for a program.
    thread
        The program thread that runs it, None for a command of a client.
    """

    state: State
    handles: Handles
    engine: Engine
    pusher: RecordPusher
    values: ControllerValues
    handle: str
    thread: Thread | None
    text: str

    def value(self, text: str) -> float:
        """Return the value of a number or expression."""
        return evaluate(text, self.values)

    def number(self, low: int, high: int) -> int:
        """Return the only argument, a whole number within a range."""
        if not self.text.strip():
            raise CommandError(errors.TOO_FEW_FIELDS)
        return arguments.integer(self.value(self.text), low, high)

    def axes(self, text: str | None = None) -> list[int]:
        """Return the indices of the axes that the command lists, all if it lists none."""
        settings = self.state.settings
        listed = self.text if text is None else text
        return arguments.axis_list(listed, settings.axes, settings.missing_axis_error)

    def fields(self) -> list[tuple[int, str]]:
        """Return axis index and text of each field of `A=1` or `1,,2`."""
        settings = self.state.settings
        return list(arguments.fields_by_axis(self.text, settings.axes, settings.missing_axis_error))

    def program_thread(self) -> Thread:
        """Return the thread that runs the command; error 2 for a client's command."""
        if self.thread is None:
            raise CommandError(errors.ONLY_IN_PROGRAM)
        return self.thread

    def require_client(self) -> None:
        """Raise error 3 for a command of a program."""
        if self.thread is not None:
            raise CommandError(errors.NOT_IN_PROGRAM)


Handler = Callable[[Request], "str | bytes | Wait | Download | None"]
"""Carries a command out.

It returns the line to print before the prompt, bytes that go out as they are, what to wait for
before the prompt, or None for the prompt alone.
"""
