"""Strictly framed commands and replies over one handle.

Every command is answered by exactly one prompt: ``:`` alone, text with CR LF and ``:``, or ``?`` alone.
Whatever else arrives means that host and controller no longer agree on which reply belongs to which
command. Such a link is closed at once and never used again, and so is one that stays silent too long.
"""

from __future__ import annotations

import hashlib
import re
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NoReturn, ParamSpec, TypeVar

from ibfctl.errors import ControllerError, LinkError
from ibfctl.machine.controller import Observer
from ibfctl_drivers.galil.marked import MarkedText
from ibfctl_drivers.galil.transport import Transport

MAX_REPLY_BYTES = 65536
END_OF_UPLOAD = b"\x1a:"
MAX_BYTES_IN_FLIGHT = 400
"""No manual says how much the controller's input buffer takes; one documented packet is known to fit."""

_PROMPT = re.compile(rb"[:?]")
_PRINTABLE = re.compile(rb"[\x20-\x7e\t\r\n]*")

P = ParamSpec("P")
T = TypeVar("T")


class RejectedError(ControllerError):
    """The controller answered ``?``; `index` counts the lines of the batch that it accepted before."""

    code = "rejected"

    def __init__(self, message: str, hint: str = "", index: int = 0) -> None:
        super().__init__(message, hint)
        self.index = index


class Link:
    """One handle of the controller; calls from several threads wait for each other, except `shout`.

    Parameters
    ----------
    transport
        The open byte pipe; the link closes it.
    name
        What the handle is for; it appears in messages.
    timeout_s
        How long any single reply may take.
    on_exchange
        Told of everything that goes over the wire.
    """

    def __init__(
        self, transport: Transport, name: str, timeout_s: float, on_exchange: Observer | None = None
    ) -> None:
        self._transport = transport
        self._on_exchange = on_exchange
        self._name = name
        self._usual_timeout_s = self._timeout_s = timeout_s
        self._lock = threading.Lock()
        self._received = bytearray()
        self._marked = MarkedText(name)
        self._owed = 0
        self._closed_because: str | None = None

    @property
    def is_open(self) -> bool:
        """False after `close` and after any failure."""
        return self._closed_because is None

    def close(self) -> None:
        """Close the handle; never raises."""
        self._closed_because = self._closed_because or "it was closed"
        self._transport.close()

    def limit(self, timeout_s: float | None) -> None:
        """Wait no longer than `timeout_s` for any reply from now on; None as long as usual."""
        self._timeout_s = min(timeout_s or self._usual_timeout_s, self._usual_timeout_s)

    def ask(self, question: str) -> str:
        """Send a command that answers with data; return its text, without its line end.

        Raises
        ------
        RejectedError
            If the controller answers ``?``; the message holds its reason.
        LinkError
            If it answers too late or otherwise than the protocol allows. The link is closed then.
        """
        return self._request(question, with_data=True)

    def tell(self, command: str) -> None:
        """Send a command that answers without data; raises as `ask`."""
        self._request(command, with_data=False)

    def tell_and_ask(self, command: str, question: str) -> str:
        """Send a command and a question in one packet, and return the answer; raises as `ask`."""
        with self._lock:
            self._settle()
            self._send(f"{command}\r{question}\r".encode("ascii"))
            deadline = time.monotonic() + self._timeout_s
            (said, told), (text, answered) = self._reply(deadline), self._reply(deadline)
            self._note(f"{command}\r{question}", f"{':' if told else '?'}{text}{':' if answered else '?'}")
            if said or self._received:
                self._fail(f"more than one reply to {command!r} or {question!r}")
        if not (told and text):
            raise RejectedError(f"controller refused {command!r} or {question!r}", "was it restarted?")
        return text

    def pipeline(self, lines: Sequence[bytes], told_as: str | None = None) -> None:
        """Send complete lines that answer without data, several in flight, and check every prompt.

        Parameters
        ----------
        lines
            What is sent.
        told_as
            What the observer is told in place of many lines; a digest of them is added.

        Raises
        ------
        RejectedError
            At the first ``?``. Nothing more is sent; replies still owed are collected by the next call.
        LinkError
            As `request`; any single line must be answered within the link's timeout.
        """
        with self._lock:
            self._settle()
            try:
                self._pump(lines)
            except ControllerError as error:
                self._tell(told_as, lines, str(error.message))
                raise
            self._tell(told_as, lines, ":" * len(lines) if told_as is None else ":")

    def _tell(self, told_as: str | None, lines: Sequence[bytes], reply: str) -> None:
        text = b"".join(lines)
        digest = f"{told_as}, {len(lines)} lines, sha256 {hashlib.sha256(text).hexdigest()}"
        self._note(text.decode("ascii").strip("\r") if told_as is None else digest, reply)

    def _note(self, sent: str, reply: str) -> None:
        if self._on_exchange is not None:
            self._on_exchange(self._name, sent, reply, time.monotonic())

    def download(self, lines: Sequence[str]) -> None:
        """Replace the controller's program; it answers once for the program and once for the command.

        A refusal closes the link: nobody knows how many of the lines were then taken for commands.
        """
        text = "".join(f"{line}\r" for line in ["DL", *lines, "\\"])
        with self._lock:
            self._settle()
            self._send(text.encode("ascii"))
            deadline = time.monotonic() + self._timeout_s
            for _ in range(2):
                if not self._reply(deadline)[1]:
                    self._fail("the controller refused a program")
            self._note(text.strip("\r"), "::")

    def upload(self) -> list[str]:
        """Return the lines of the controller's program; they end with a byte of their own."""
        with self._lock:
            self._settle()
            self._send(b"UL\r")
            deadline = time.monotonic() + self._timeout_s
            while not self._received.endswith(END_OF_UPLOAD):
                if len(self._received) > MAX_REPLY_BYTES or self._received.startswith(b"?"):
                    self._fail(f"malformed program {bytes(self._received[:40])!r}")
                self._wait(deadline)
            text = bytes(self._received[: -len(END_OF_UPLOAD)])
            self._received.clear()
        if not _PRINTABLE.fullmatch(text):
            self._fail(f"malformed program {text[:40]!r}")
        self._note("UL", text.decode("ascii"))
        return [line.rstrip() for line in text.decode("ascii").splitlines() if line.strip()]

    def shout(self, data: bytes) -> None:
        """Put bytes on the wire without waiting for any lock; count their prompts with `heard`.

        Only for a handle that serves no other purpose, so that nobody else is in the middle of a reply.
        """
        self._send(data)
        self._note(data.decode("ascii").strip("\r"), "")

    def heard(self, prompts: int) -> list[bool]:
        """Wait for the prompts of what was shouted; return which of it was accepted."""
        with self._lock:
            deadline = time.monotonic() + self._timeout_s
            accepted = [self._reply(deadline)[1] for _ in range(prompts)]
        self._note("", "".join("?:"[good] for good in accepted))
        return accepted

    def abandon(self, reason: str) -> None:
        """Let nobody use this link any more, though its transport stays open until `close`; waits for no lock."""
        self._closed_because = self._closed_because or reason

    def _request(self, command: str, *, with_data: bool) -> str:
        with self._lock:
            text, accepted = self._exchange(command)
            if accepted:
                if bool(text) is not with_data:
                    self._fail(f"{text[:40]!r} is no answer to {command!r}")
                return text
            reason, known = self._exchange("TC1")
        raise RejectedError(
            f"controller refused {command!r}: {reason if known and reason else 'no reason given'}",
            "look the code up in the controller's command reference",
        )

    def _exchange(self, command: str) -> tuple[str, bool]:
        self._settle()
        self._send(f"{command}\r".encode("ascii"))
        text, accepted = self._reply(time.monotonic() + self._timeout_s)
        self._note(command, f"{text}{':' if accepted else '?'}")
        if self._received:
            self._fail(f"more than one reply to {command!r}: {bytes(self._received[:40])!r} too many")
        return text, accepted

    def _settle(self) -> None:
        """Collect replies still owed, then insist on silence: a byte that nobody asked for is a fault."""
        deadline = time.monotonic() + self._timeout_s
        while self._owed:
            self._reply(deadline)
            self._owed -= 1
        self._take(self._call(self._transport.waiting))
        if self._received:
            self._fail(f"{bytes(self._received[:40])!r} came unasked")

    def _pump(self, lines: Sequence[bytes]) -> None:
        in_flight: deque[tuple[int, float]] = deque()
        bytes_in_flight = accepted = queued = 0
        while accepted < len(lines):
            now = time.monotonic()
            batch = queued
            while batch < len(lines) and bytes_in_flight + len(lines[batch]) <= MAX_BYTES_IN_FLIGHT:
                bytes_in_flight += len(lines[batch])
                in_flight.append((len(lines[batch]), now + self._timeout_s))
                batch += 1
            if batch > queued:
                self._send(b"".join(lines[queued:batch]))
                queued = batch
            prompts, rejected = self._prompts(in_flight[0][1], len(in_flight))
            for _ in range(prompts):
                bytes_in_flight -= in_flight.popleft()[0]
            accepted += prompts
            if rejected:
                self._owed = len(in_flight) - 1
                raise RejectedError("controller refused a line", index=accepted)

    def _prompts(self, deadline: float, at_most: int) -> tuple[int, bool]:
        """Return how many good prompts came, and whether a bad one followed."""
        if not self._received:
            self._wait(deadline)
        good = len(self._received) - len(self._received.lstrip(b":"))
        rest = self._received[good : good + 1]
        rejected = rest == b"?"
        if good + rejected > at_most or (rest and not rejected):
            self._fail(f"{bytes(self._received[:40])!r} came where only prompts may")
        del self._received[: good + rejected]
        return good, rejected

    def _reply(self, deadline: float) -> tuple[str, bool]:
        while (prompt := _PROMPT.search(self._received)) is None:
            if len(self._received) > MAX_REPLY_BYTES:
                self._fail("a reply that does not end")
            self._wait(deadline)
        text, accepted = bytes(self._received[: prompt.start()]), prompt.group() == b":"
        framed = text.endswith(b"\r\n") if accepted and text else not text
        if not framed or not _PRINTABLE.fullmatch(text):
            self._fail(f"malformed reply {bytes(self._received[:40])!r}")
        del self._received[: prompt.end()]
        return text.decode("ascii").strip(), accepted

    def _wait(self, deadline: float) -> None:
        """Wait for bytes; a deadline that has passed ends even a flood of unsolicited ones."""
        remaining_s = deadline - time.monotonic()
        if remaining_s <= 0:
            self._fail(f"no answer within {self._timeout_s:g} s")
        self._take(self._call(self._transport.receive, remaining_s))

    def _take(self, data: bytes) -> None:
        self._received += self._marked.out_of(data)

    def _send(self, data: bytes) -> None:
        self._call(self._transport.send, data, self._timeout_s)

    def _call(self, operation: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> T:
        if self._closed_because is not None:
            raise LinkError(f"{self._name} link: closed because {self._closed_because}", "connect again")
        try:
            return operation(*arguments, **named)
        except OSError as error:
            self._fail(str(error) or type(error).__name__, error)

    def _fail(self, reason: str, cause: Exception | None = None) -> NoReturn:
        self._closed_because = reason
        self._transport.close()
        raise LinkError(
            f"{self._name} link: {reason}", "check power and network of the controller, then connect again"
        ) from cause
