"""A serial line to a TCP controller: a pty pair, with the controller's echo until it is switched off."""

from __future__ import annotations

import os
import select
import socket
import threading
import tty
from types import TracebackType
from typing import Self

ECHO_OFF = b"EO 0\r"


class SerialLineTo:
    """Use as a context manager; `path` is the port's name."""

    def __init__(self, port: int, echoes: bool = True) -> None:
        self._server = socket.create_connection(("127.0.0.1", port))
        self._controller, self._device = os.openpty()
        tty.setraw(self._device)
        self.path = os.ttyname(self._device)
        self.silent = False
        self._echoes = echoes
        self._done, self._wake = os.pipe()
        self._thread = threading.Thread(target=self._forward)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.write(self._wake, b".")
        self._thread.join()
        self._server.close()
        for descriptor in (self._controller, self._device, self._done, self._wake):
            os.close(descriptor)

    def _forward(self) -> None:
        while True:
            readable, _, _ = select.select([self._controller, self._server, self._done], [], [])
            if self._done in readable:
                return
            if self._controller in readable:
                data = os.read(self._controller, 4096)
                if self._echoes:
                    os.write(self._controller, data)
                    self._echoes = ECHO_OFF not in data
                self._server.sendall(data)
            if self._server in readable:
                reply = self._server.recv(4096)
                if not reply:
                    return
                if not self.silent:
                    os.write(self._controller, reply)
