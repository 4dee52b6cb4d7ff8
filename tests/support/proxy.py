"""A TCP proxy in front of a controller that delays, spoils or cuts what passes."""

from __future__ import annotations

import contextlib
import queue
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Self

Spoil = Callable[[int, bytes], "bytes | None"]

RESET = struct.pack("ii", 1, 0)


class Proxy:
    """Forwards every handle to `host:port`; `commands` holds all bytes that each handle sent.

    Parameters
    ----------
    on_command, on_reply
        `(handle, data) -> data`: what is forwarded instead; None resets the handle.
    latency_s
        How much later each reply arrives.
    at
        Port to listen on; 0 for any free one.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        on_command: Spoil = lambda handle, data: data,
        on_reply: Spoil = lambda handle, data: data,
        latency_s: float = 0.0,
        at: int = 0,
    ) -> None:
        self.port = at
        self._target = (host, port)
        self.on_command = on_command
        self.on_reply = on_reply
        self.latency_s = latency_s
        self.commands: list[bytes] = []
        self.log: list[tuple[float, int, bytes]] = []
        self._sockets: list[socket.socket] = []
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self.port = self._listener.getsockname()[1]
        self._start(self._accept)
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._threads[0].join()
        for handle in self._sockets:
            with contextlib.suppress(OSError):
                handle.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()
        for handle in self._sockets:
            handle.close()

    def reset(self, handle: int) -> None:
        """Cut a handle as a crashing peer would."""
        client = self._sockets[2 * handle]
        with contextlib.suppress(OSError):
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
            client.shutdown(socket.SHUT_RDWR)

    def _start(self, target: Callable[..., None], *arguments: object) -> None:
        thread = threading.Thread(target=target, args=arguments)
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
                server = socket.create_connection(self._target)
            except OSError:
                return
            for end in (client, server):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            number = len(self.commands)
            self.commands.append(b"")
            self._sockets += [client, server]
            replies: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()
            self._start(self._forward_commands, number, client, server)
            self._start(self._collect_replies, server, replies)
            self._start(self._forward_replies, number, client, replies)

    def _forward_commands(self, number: int, client: socket.socket, server: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := client.recv(65536):
                self.commands[number] += data
                self.log.append((time.monotonic(), number, data))
                spoiled = self.on_command(number, data)
                if spoiled is None:
                    self.reset(number)
                    break
                server.sendall(spoiled)
        with contextlib.suppress(OSError):
            server.shutdown(socket.SHUT_RDWR)

    def _collect_replies(
        self, server: socket.socket, replies: queue.SimpleQueue[tuple[float, bytes]]
    ) -> None:
        with contextlib.suppress(OSError):
            while data := server.recv(65536):
                replies.put((time.monotonic() + self.latency_s, data))
        replies.put((0.0, b""))

    def _forward_replies(
        self, number: int, client: socket.socket, replies: queue.SimpleQueue[tuple[float, bytes]]
    ) -> None:
        with contextlib.suppress(OSError):
            while True:
                due, data = replies.get()
                if not data:
                    break
                time.sleep(max(due - time.monotonic(), 0.0))
                spoiled = self.on_reply(number, data)
                if spoiled is None:
                    self.reset(number)
                    break
                client.sendall(spoiled)
        with contextlib.suppress(OSError):
            client.shutdown(socket.SHUT_RDWR)
