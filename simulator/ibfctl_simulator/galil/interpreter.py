"""From the text of one command to its effect and its reply."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.commands import (
    configuration,
    contour,
    flow,
    homing,
    link,
    memory,
    motion,
    outputs,
    programs,
    pvt,
    record,
    status,
    trippoints,
    variables,
)
from ibfctl_simulator.galil.commands.request import Download, Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.handles import Handles
from ibfctl_simulator.galil.operands import ControllerValues
from ibfctl_simulator.galil.programs.engine import Engine
from ibfctl_simulator.galil.programs.thread import Thread, Wait
from ibfctl_simulator.galil.record import RecordPusher
from ibfctl_simulator.galil.state import State

GOOD, BAD = ":", "?"

HARMLESS = frozenset(
    """
    PV MG TC TP RP TE TD TV TT TS TB SC QR QZ SB CB OB OP IF EL EN JP JS RE RI WT AT AM MC AI NO XQ HX TH WH
    """.split()  # noqa: SIM905 - a list of 34 strings is harder to read
)
"""Commands that change nothing an axis has looked ahead with."""

MOST_KNOWN = 4096

_AXIS_LETTERS = frozenset("ABCDEFGHXYZWNMST")


@dataclass(frozen=True)
class Pending:
    """A reply that is due when a wait is over."""

    wait: Wait


class _Call(NamedTuple):
    """A command ready to be carried out."""

    handler: Handler
    text: str
    harmless: bool


Reply = str | Pending | Download
"""All that goes back for one command, or what has to happen first."""


class Interpreter:
    """Carries commands out on a controller and forms the replies."""

    def __init__(self, state: State, handles: Handles, engine: Engine, pusher: RecordPusher) -> None:
        self._state = state
        self._handles = handles
        self._engine = engine
        self._pusher = pusher
        self._values = ControllerValues(state, engine, handles)
        self._handlers: dict[str, Handler] = {}
        self._known: dict[str, _Call] = {}
        for module in (
            configuration,
            contour,
            flow,
            homing,
            link,
            memory,
            motion,
            outputs,
            programs,
            pvt,
            record,
            status,
            trippoints,
            variables,
        ):
            self._handlers.update(module.TABLE)

    def reply(self, command: str, handle: str) -> Reply:
        """Carry out one command of the client on `handle` and return what goes back to it."""
        try:
            outcome = self._run(command, handle, None)
        except CommandError as error:
            self._state.error_code = error.code
            return BAD
        if outcome is None:
            return GOOD
        if isinstance(outcome, Wait):
            return Pending(outcome)
        if isinstance(outcome, Download):
            return outcome
        if isinstance(outcome, bytes):
            return outcome.decode("latin-1") + GOOD
        return f"{outcome}\r\n{GOOD}"

    def execute(self, command: str, thread: Thread) -> str | Wait | None:
        """Carry out one statement of a program.

        Raises
        ------
        CommandError
            If it is rejected.
        """
        outcome = self._run(command, "", thread)
        if isinstance(outcome, bytes | Download):
            raise CommandError(errors.NOT_IN_PROGRAM)
        return outcome

    def _run(self, command: str, handle: str, thread: Thread | None) -> str | bytes | Wait | Download | None:
        if not command:
            return None
        call = self._known.get(command)
        if call is None:
            call = self._parse(command)
            if thread is not None:  # a program repeats itself, a client seldom does
                self._remember(command, call)
        if not call.harmless:
            for axis in self._state.axes:
                axis.forget()
        return call.handler(
            Request(
                self._state, self._handles, self._engine, self._pusher, self._values, handle, thread, call.text
            )
        )

    def _parse(self, command: str) -> _Call:
        name, equals, expression = command.partition("=")
        handler = self._handlers.get(command[:2])
        if equals and not (handler is not None and len(name) == 3 and name[2] in _AXIS_LETTERS):
            target = variables.target(name)
            if target is not None:
                return _Call(lambda request: variables.assign(request, target), expression.strip(), harmless=True)
        if handler is None:
            raise CommandError(errors.UNKNOWN_COMMAND)
        return _Call(handler, command[2:], harmless=command[:2] in HARMLESS)

    def _remember(self, command: str, call: _Call) -> None:
        if len(self._known) >= MOST_KNOWN:
            self._known.clear()
        self._known[command] = call
