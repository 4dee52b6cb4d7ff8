"""Permanent memory and starting anew: `BN`, `BP`, `BV`, `RS`."""

from __future__ import annotations

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.programs.thread import Wait
from ibfctl_simulator.galil.restart import restart


def burn_parameters(request: Request) -> None:
    """`BN`: keep the settings of the axes."""
    if request.engine.running:
        raise CommandError(errors.PROGRAM_RUNNING)
    request.state.burn_parameters()


def burn_program(request: Request) -> Wait:
    """`BP`: keep the program; the controller answers only when it is written."""
    request.engine.burned = request.engine.program
    state = request.state
    due = state.sample + round(state.settings.burn_s / state.sample_period_s)
    return Wait(lambda: state.sample >= due, due=due)


def burn_variables(request: Request) -> None:
    """`BV`: keep the variables."""
    request.state.burn_variables()


def reset(request: Request) -> None:
    """`RS`: start anew from what was burned."""
    keep = request.state.settings.reset_keeps_connections
    restart(request.state, request.engine, request.handles, keep_connections=keep)


TABLE: dict[str, Handler] = {
    "BN": burn_parameters,
    "BP": burn_program,
    "BV": burn_variables,
    "RS": reset,
}
