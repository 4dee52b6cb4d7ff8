"""The emulator behind a real socket."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Self

import pytest
from ibfctl_simulator.galil.clock import SteppedClock
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.inprocess import EmulatorServer
from ibfctl_simulator.galil.settings import Settings


class Client:
    """A raw TCP client that counts prompts."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=5)

    def ask(self, data: str, prompts: int = 1) -> str:
        """Send `data` as it is and read until `prompts` prompts have come."""
        self.socket.sendall(data.encode("latin-1"))
        return self.read(prompts)

    def read(self, prompts: int = 1) -> str:
        """Read until `prompts` prompts have come."""
        received = ""
        while received.count(":") + received.count("?") < prompts:
            piece = self.socket.recv(4096)
            assert piece, f"connection closed after {received!r}"
            received += piece.decode("latin-1")
        return received

    def gone(self) -> bool:
        """Whether the controller has closed the connection, in order or by reset."""
        try:
            return self.socket.recv(1) == b""
        except ConnectionResetError:
            return True

    def close(self) -> None:
        """Close in good order."""
        self.socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@pytest.fixture
def server() -> Iterator[EmulatorServer]:
    """Two axes on a stepped clock."""
    with EmulatorServer(Controller(Settings()), SteppedClock()) as running:
        yield running


@pytest.fixture
def connect(server: EmulatorServer) -> Iterator[Callable[[], Client]]:
    """Open clients, all closed at the end."""
    clients: list[Client] = []

    def connect() -> Client:
        clients.append(Client(server.port))
        return clients[-1]

    yield connect
    for client in clients:
        client.close()


@pytest.fixture
def client(connect: Callable[[], Client]) -> Client:
    """One client."""
    return connect()


@pytest.fixture
def serve() -> Iterator[Callable[..., Client]]:
    """Start an emulator with settings of its own and connect a client to it."""
    with ExitStack() as stack:

        def serve(**settings: object) -> Client:
            controller = Controller(Settings(**settings))
            running = stack.enter_context(EmulatorServer(controller, SteppedClock()))
            client = Client(running.port)
            stack.callback(client.close)
            return client

        yield serve


@pytest.fixture
def make_client() -> type[Client]:
    """Return the class of raw clients, for tests that run servers of their own."""
    return Client
