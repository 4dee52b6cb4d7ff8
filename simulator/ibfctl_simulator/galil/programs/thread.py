"""One program thread: where it is, where it returns to, and what it waits for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.errors import CommandError

DEEPEST_STACK = 16

Reason = Literal["call", "LIMSWI", "POSERR", "TCPERR", "ININT", "CMDERR"]


@dataclass(frozen=True)
class Wait:
    """A trippoint.

    Attributes
    ----------
    done : tells whether the wait is over
    due : absolute sample at which it is over, if that is known
    poll : whether it can be over at any sample, so that each must be looked at
    lull : tells for how many samples it surely goes on unless a command comes; None for any number
    """

    done: Callable[[], bool]
    due: int | None = None
    poll: bool = False
    lull: Callable[[], int | None] | None = None


@dataclass(frozen=True)
class Frame:
    """Where a subroutine returns to, and what the thread was waiting for when it was called."""

    place: int
    reason: Reason
    wait: Wait | None = None


@dataclass
class Thread:
    """A running thread.

    Attributes
    ----------
    place
        Index of the statement that comes next.
    """

    number: int
    place: int
    stack: list[Frame] = field(default_factory=list)
    wait: Wait | None = None

    @property
    def serving(self) -> Reason | None:
        """The innermost automatic subroutine at work."""
        return next((frame.reason for frame in reversed(self.stack) if frame.reason != "call"), None)

    def call(self, destination: int, reason: Reason = "call") -> None:
        """Go to a subroutine.

        Raises
        ------
        CommandError
            12 if the stack is full.
        """
        if len(self.stack) >= DEEPEST_STACK:
            raise CommandError(errors.STACK_TOO_DEEP)
        self.stack.append(Frame(self.place, reason, self.wait))
        self.place, self.wait = destination, None

    def leave(self, *, restore_wait: bool) -> None:
        """Return from the innermost subroutine."""
        frame = self.stack.pop()
        self.place = frame.place
        self.wait = frame.wait if restore_wait else None
