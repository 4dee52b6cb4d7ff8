"""From the text of one command to its effect and its reply."""

from __future__ import annotations

import re

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.commands import link, motion, outputs, pvt, status
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.expressions import evaluate
from ibfctl_simulator.galil.handles import Handles
from ibfctl_simulator.galil.operands import ControllerValues

_VARIABLE = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,7}")
_AXIS_LETTERS = frozenset("ABCDEFGHXYZWNMST")


class Interpreter:
    """Carries commands out on a controller and forms the replies."""

    def __init__(self, controller: Controller, handles: Handles) -> None:
        self._controller = controller
        self._handles = handles
        self._handlers: dict[str, Handler] = {
            **motion.TABLE,
            **pvt.TABLE,
            **status.TABLE,
            **outputs.TABLE,
            **link.TABLE,
        }

    def reply(self, command: str, handle: str) -> str:
        """Carry out one command of the client on `handle` and return all that goes back to it."""
        try:
            text = self._execute(command, handle)
        except CommandError as error:
            self._controller.error_code = error.code
            return "?"
        return ":" if text is None else f"{text}\r\n:"

    def _execute(self, command: str, handle: str) -> str | None:
        if not command:
            return None
        name, equals, expression = command.partition("=")
        handler = self._handlers.get(command[:2])
        if equals and not (handler is not None and len(name) == 3 and name[2] in _AXIS_LETTERS):
            stripped = name.strip()
            if _VARIABLE.fullmatch(stripped):
                return self._assign(stripped, expression)
        if handler is None:
            raise CommandError(errors.UNKNOWN_COMMAND)
        return handler(Request(self._controller, self._handles, handle, command[2:]))

    def _assign(self, name: str, expression: str) -> str | None:
        values = ControllerValues(self._controller)
        if expression.strip() == "?":
            return f"{values.variable(name):.4f}"
        self._controller.variables[name] = evaluate(expression, values)
        return None
