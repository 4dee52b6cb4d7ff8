"""How bytes travel to a controller: a TCP handle or a serial line."""

from __future__ import annotations

import select
import socket
import time
from typing import Protocol

CHUNK_BYTES = 65536
SERIAL_SLICE_S = 0.01


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


class SerialTransport:
    """An RS-232 line; needs pyserial, which is imported only here.

    Parameters
    ----------
    path
        Name of the port, such as ``/dev/ttyS0`` or ``COM1``.
    baud
        Speed of the line.
    timeout_s
        How long the line may take no more bytes.

    Raises
    ------
    OSError
        If the port cannot be opened, or pyserial is not installed.
    """

    def __init__(self, path: str, baud: int, timeout_s: float) -> None:
        try:
            import serial
        except ImportError as error:
            raise OSError("pyserial is not installed; install ibfctl[serial]") from error
        self._port = serial.Serial(path, baud, timeout=SERIAL_SLICE_S, write_timeout=timeout_s)

    def send(self, data: bytes, timeout_s: float) -> None:
        """Hand all of `data` to the line."""
        self._port.write(data)

    def receive(self, timeout_s: float) -> bytes:
        """Return at least one byte; wait for it no longer than `timeout_s`."""
        deadline = time.monotonic() + timeout_s
        while True:
            data = bytes(self._port.read(max(self._port.in_waiting, 1)))
            if data:
                return data
            if time.monotonic() >= deadline:
                raise TimeoutError("no answer")

    def waiting(self) -> bytes:
        """Return what has arrived already."""
        return bytes(self._port.read(self._port.in_waiting)) if self._port.in_waiting else b""

    def close(self) -> None:
        """Close the line; never raises."""
        self._port.close()
