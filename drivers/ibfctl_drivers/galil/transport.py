"""How bytes travel to a controller: a TCP handle."""

from __future__ import annotations

import select
import socket
import time
from typing import Protocol

CHUNK_BYTES = 65536


class Transport(Protocol):
    """A byte pipe. Failures are `OSError`; silence beyond the time given is `TimeoutError`."""

    def send(self, data: bytes, timeout_s: float) -> None:
        """Hand all of `data` to the wire."""

    def receive(self, timeout_s: float) -> bytes:
        """Return at least one byte; wait for it no longer than `timeout_s`."""

    def waiting(self) -> bytes:
        """Return what has arrived already, perhaps nothing, without waiting."""

    def close(self) -> None:
        """Close the pipe; never raises."""


class TcpTransport:
    """One of the controller's Ethernet handles.

    Parameters
    ----------
    host, port
        Where the controller listens.
    timeout_s
        How long connecting may take.

    Raises
    ------
    OSError
        If no connection comes about.
    """

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        self._socket = socket.create_connection((host, port), timeout=timeout_s)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)

    def send(self, data: bytes, timeout_s: float) -> None:
        """Hand all of `data` to the wire; a peer that takes nothing for `timeout_s` is a `TimeoutError`."""
        deadline = time.monotonic() + timeout_s
        view = memoryview(data)
        while view:
            try:
                view = view[self._socket.send(view) :]
            except BlockingIOError:
                self._wait_writable(deadline - time.monotonic())

    def receive(self, timeout_s: float) -> bytes:
        """Return at least one byte; wait for it no longer than `timeout_s`."""
        data = self.waiting()
        if data:
            return data
        readable, _, _ = select.select([self._socket], [], [], max(timeout_s, 0.0))
        if not readable:
            raise TimeoutError("no answer")
        return self.waiting()

    def waiting(self) -> bytes:
        """Return what has arrived already; a connection closed by the peer is a `ConnectionError`."""
        try:
            data = self._socket.recv(CHUNK_BYTES)
        except BlockingIOError:
            return b""
        if not data:
            raise ConnectionResetError("closed by the controller")
        return data

    def close(self) -> None:
        """Close the handle; never raises."""
        self._socket.close()

    def _wait_writable(self, timeout_s: float) -> None:
        _, writable, _ = select.select([], [self._socket], [], max(timeout_s, 0.0))
        if not writable:
            raise TimeoutError("the controller takes no more bytes")
