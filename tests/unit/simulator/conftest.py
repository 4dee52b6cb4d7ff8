"""A controller without sockets: commands go straight to the interpreter, time is advanced by hand."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.settings import Settings


class Console:
    """Sends commands as the client on handle A and reads whole replies."""

    def __init__(self, settings: Settings | None = None) -> None:
        self.controller = Controller(settings)
        self.state = self.controller.state
        self.axis = self.state.axes[0]

    def __call__(self, command: str) -> str:
        reply = self.controller.reply(command, "A")
        assert isinstance(reply, str), reply
        return reply

    def good(self, *commands: str) -> None:
        """Send commands that must be accepted without data."""
        for command in commands:
            assert self(command) == ":", command

    def code(self, command: str) -> int:
        """Send a command that must be rejected and return its error code."""
        assert self(command) == "?", command
        return int(self("TC").split("\r")[0])

    def number(self, expression: str) -> float:
        """Value of an expression by `MG`."""
        reply = self(f"MG {expression}")
        assert reply.endswith("\r\n:"), (expression, reply)
        return float(reply[:-3])


@pytest.fixture
def console() -> Console:
    """Two axes, servos on."""
    made = Console()
    made.good("SH")
    return made


@pytest.fixture
def make_console() -> Callable[..., Console]:
    """Make a console with settings of its own."""
    return lambda **settings: Console(Settings(**settings))
