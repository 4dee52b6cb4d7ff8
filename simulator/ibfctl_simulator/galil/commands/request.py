"""What a command handler is given and what it may answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ibfctl_simulator.galil import arguments
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.expressions import evaluate
from ibfctl_simulator.galil.handles import Handles
from ibfctl_simulator.galil.operands import ControllerValues


@dataclass(frozen=True)
class Request:
    """One command: the text behind its two letters, where it came from, and what it acts on.

    Attributes
    ----------
    handle
        Letter of the Ethernet handle that sent it; empty for none.
    """

    controller: Controller
    handles: Handles
    handle: str
    text: str

    def value(self, text: str) -> float:
        """Return the value of a number or expression."""
        return evaluate(text, ControllerValues(self.controller))

    def axes(self, text: str | None = None) -> list[int]:
        """Return the indices of the axes that the command lists, all if it lists none."""
        settings = self.controller.settings
        listed = self.text if text is None else text
        return arguments.axis_list(listed, settings.axes, settings.missing_axis_error)

    def fields(self) -> list[tuple[int, str]]:
        """Return axis index and text of each field of `A=1` or `1,,2`."""
        settings = self.controller.settings
        return list(arguments.fields_by_axis(self.text, settings.axes, settings.missing_axis_error))


Handler = Callable[[Request], str | None]
"""Carries a command out; returns the line to print before the prompt, None for the prompt alone."""
