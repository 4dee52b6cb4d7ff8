"""Ways to a controller: a fresh Ethernet handle for every duty, or one serial line for all of them."""

from __future__ import annotations

import time
from typing import Protocol

from ibfctl.errors import LinkError
from ibfctl.machine.controller import Observer
from ibfctl.machine.description import Connection
from ibfctl_drivers.galil.link import Link
from ibfctl_drivers.galil.transport import SerialTransport, TcpTransport, Transport

SILENCE_S = 0.1


class Handles(Protocol):
    """Opens links.

    Attributes
    ----------
    shared
        Whether all duties share one line: then an abort breaks into what the others are doing on it.
    """

    shared: bool

    def open(self, name: str) -> Link:
        """Return an open link.

        Raises
        ------
        LinkError
            If the controller cannot be reached.
        """


def handles_to(connection: Connection, on_exchange: Observer | None = None) -> Handles:
    """Return the way that the machine file names; `on_exchange` is told of everything on it."""
    way = TcpHandles if connection.serial is None else SerialLine
    return way(connection, on_exchange)


class TcpHandles:
    """Every link is a handle of its own."""

    shared = False

    def __init__(self, connection: Connection, on_exchange: Observer | None = None) -> None:
        self._connection = connection
        self._on_exchange = on_exchange

    def open(self, name: str) -> Link:
        """Connect."""
        host, port, timeout_s = self._connection.host, self._connection.port, self._connection.timeout_s
        try:
            transport = TcpTransport(host, port, timeout_s)
        except OSError as error:
            raise LinkError(
                f"controller at {host}:{port} cannot be reached ({error})",
                "check power, network, host and port in the machine file; all handles may be in use",
            ) from error
        return Link(transport, name, timeout_s, self._on_exchange)


class SerialLine:
    """All links are one and the same, until it fails; then the line is opened anew."""

    shared = True

    def __init__(self, connection: Connection, on_exchange: Observer | None = None) -> None:
        self._connection = connection
        self._on_exchange = on_exchange
        self._link: Link | None = None

    def open(self, name: str) -> Link:
        """Return the one link."""
        if self._link is None or not self._link.is_open:
            if self._link is not None:
                self._link.close()
            self._link = self._fresh()
        return self._link

    def _fresh(self) -> Link:
        path, timeout_s = self._connection.serial or "", self._connection.timeout_s
        try:
            transport = SerialTransport(path, self._connection.baud, timeout_s)
            try:
                _quieten(transport, timeout_s)
            except OSError:
                transport.close()
                raise
        except OSError as error:
            raise LinkError(
                f"controller at serial port {path} cannot be reached ({error})",
                "check the cable, and serial and baud in the machine file",
            ) from error
        return Link(transport, "serial", timeout_s, self._on_exchange)


def _quieten(transport: Transport, timeout_s: float) -> None:
    """End a line that may have been begun, switch the echo off, and let pass whatever comes of it."""
    transport.send(b"\rEO 0\r", timeout_s)
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        try:
            transport.receive(SILENCE_S)
        except TimeoutError:
            return
    raise TimeoutError("the line does not fall silent")
