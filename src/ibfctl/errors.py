"""The one tree of errors: a stable code, a message that says what and where, a hint that says what to do."""

from __future__ import annotations

from typing import ClassVar


class IbfctlError(Exception):
    """Base of every error that a user is meant to see.

    Parameters
    ----------
    message
        What is wrong and where, in one line.
    hint
        What the operator can do about it, in one line.
    """

    code: ClassVar[str] = "error"
    exit_code: ClassVar[int] = 1

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return f"{self.message}; {self.hint}" if self.hint else self.message

    def __reduce__(self) -> tuple[type[IbfctlError], tuple[str, str]]:
        return type(self), (self.message, self.hint)


class InputError(IbfctlError):
    """A file or a value that the user gave cannot be used."""

    code = "bad_input"
    exit_code = 2


class LimitsError(IbfctlError):
    """The job cannot be done within the machine's limits."""

    code = "limits"
    exit_code = 3


class SolverError(IbfctlError):
    """A numerical solver did not deliver a result that passes its certificate."""

    code = "solver"
    exit_code = 4


class ControllerError(IbfctlError):
    """The motion controller cannot be reached, or refused, or answered nonsense."""

    code = "controller"
    exit_code = 5


class LinkError(ControllerError):
    """The connection to the controller failed or timed out; it has been closed and is never reused."""

    code = "link"


class RunError(IbfctlError):
    """A run ended otherwise than as planned; the beam gate has been told to close."""

    code = "run"
    exit_code = 6


class AbortedError(RunError):
    """A run was aborted on request."""

    code = "aborted"
    exit_code = 7


class StoppedError(RunError):
    """A run was stopped on request: gate closed, then decelerated."""

    code = "stopped"
    exit_code = 7


class EstoppedError(RunError):
    """An emergency stop ended a run; it is latched, or the axes have lost their power."""

    code = "estopped"
    exit_code = 7


class CancelledError(IbfctlError):
    """Planning was cancelled on request; nothing was written."""

    code = "cancelled"
    exit_code = 8
