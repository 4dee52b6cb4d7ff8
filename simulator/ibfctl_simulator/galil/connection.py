"""One client's connection: bytes in, commands to the controller, replies out in order."""

from __future__ import annotations

import asyncio
import socket
import struct
from typing import Protocol

from ibfctl_simulator.galil.commands.request import Download
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.errors import DOWNLOAD, CommandError
from ibfctl_simulator.galil.faults import ReplyFaults
from ibfctl_simulator.galil.framing import Framing
from ibfctl_simulator.galil.handles import Handle
from ibfctl_simulator.galil.interpreter import BAD, GOOD, Pending
from ibfctl_simulator.galil.programs.memory import LONGEST_LINE, MOST_LINES, Program

MOST_UNREAD_BYTES = 1 << 20
"""What may wait in either direction before a client that does not read, or does not wait, is dropped."""

_RESET_ON_CLOSE = struct.pack("ii", 1, 0)


class Host(Protocol):
    """What a connection needs of the emulator it belongs to."""

    controller: Controller
    faults: ReplyFaults

    def catch_up(self) -> None:
        """Let the controller's time catch up with the clock."""

    @property
    def off(self) -> bool:
        """Whether the power is off."""

    def opened(self, connection: Connection) -> None:
        """Remember a connection."""

    def closed(self, connection: Connection) -> None:
        """Forget a connection."""


class Connection(asyncio.Protocol):
    """One client."""

    def __init__(self, host: Host) -> None:
        self._host = host
        self._framing = Framing(host.controller.settings.line_characters)
        self._transport: asyncio.Transport | None = None
        self._handle: Handle | None = None
        self._closed_by_us = False
        self._pending: Pending | None = None
        self._program: list[str] | None = None
        self._program_refused = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a free handle, or reset the connection."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._host.opened(self)
        connected = transport.get_extra_info("socket")
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        address, port = transport.get_extra_info("peername")[:2]
        if not self._host.off:
            self._handle = self._host.controller.handles.open(address, port, self.send, self.close, self.reset)
        if self._handle is None:
            self.reset()

    def data_received(self, data: bytes) -> None:
        """Carry out what can be carried out now."""
        if self._handle is None or self._closed_by_us or self._host.faults.deaf(self._handle.letter):
            return
        self._host.catch_up()
        self._framing.push(data)
        self.proceed()
        if self._framing.unread_characters > MOST_UNREAD_BYTES:
            self.reset()

    def proceed(self) -> None:
        """Carry out commands until there are none or one has to wait; replies go out in one piece."""
        if self._handle is None:
            return
        replies = []
        while not self._closed_by_us:
            try:
                reply = self._next_reply(self._handle.letter)
            except LookupError:
                break
            if reply:
                replies.append(reply)
        if replies:
            self._host.faults.deliver(self._handle.letter, replies, self.send)

    def connection_lost(self, exc: Exception | None) -> None:
        """Free the handle; a client that vanished leaves an error behind."""
        self._host.closed(self)
        if self._handle is None:
            return
        controller = self._host.controller
        controller.handles.release(self._handle)
        if not self._closed_by_us and (exc is not None or controller.settings.latch_orderly_close):
            controller.lost(self._handle.letter)

    def send(self, data: bytes) -> None:
        """Send bytes unless the connection is gone; a client that never reads is dropped."""
        if self._transport is None or self._transport.is_closing():
            return
        self._transport.write(data)
        if self._transport.get_write_buffer_size() > MOST_UNREAD_BYTES:
            self.reset()

    def close(self) -> None:
        """Close the connection in good order once everything is sent."""
        if self._transport is not None:
            self._closed_by_us = True
            self._transport.close()

    def reset(self) -> None:
        """Close the connection with a TCP reset."""
        if self._transport is None or self._closed_by_us:
            return
        self._closed_by_us = True
        connected = self._transport.get_extra_info("socket")
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET_ON_CLOSE)
        self._transport.abort()

    def _next_reply(self, handle: str) -> str:
        """Reply to the next command, empty if it has none; raises `LookupError` if nothing can go on."""
        if self._pending is not None:
            if not self._pending.wait.done():
                raise LookupError
            self._pending = None
            return GOOD
        if self._program is not None:
            return self._next_program_line(self._program)
        command = self._framing.next_command()
        controller = self._host.controller
        if command is None:
            controller.state.error_code = controller.settings.overlong_error
            return BAD
        code = self._host.faults.refusal(command)
        if code is not None:
            controller.state.error_code = code
            return BAD
        reply = controller.reply(command, handle)
        if reply == BAD and not controller.settings.continue_line_after_error:
            self._framing.drop_line()
        if isinstance(reply, Pending):
            self._pending = reply
            return ""
        if isinstance(reply, Download):
            self._program, self._program_refused = [], False
            return ""
        return reply

    def _next_program_line(self, lines: list[str]) -> str:
        """Collect a line of a program; the backslash has a prompt of its own besides that of `DL`."""
        line, ended = self._framing.next_program_line()
        engine = self._host.controller.engine
        if (line or not ended) and not self._program_refused:
            lines.append(line)
        try:
            if len(line) > LONGEST_LINE or len(lines) > MOST_LINES:
                raise CommandError(DOWNLOAD)
            if ended and not self._program_refused:
                engine.load(Program(lines))
        except CommandError as error:
            self._host.controller.state.error_code = error.code
            refused, self._program_refused = self._program_refused, True
            if ended:
                self._program = None
            return ("" if refused else BAD) + (GOOD if ended else "")
        if not ended:
            return ""
        self._program = None
        return GOOD if self._program_refused else GOOD + GOOD
