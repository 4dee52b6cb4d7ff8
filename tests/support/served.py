"""The service on a real socket, in a thread of the test."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import pytest

from ibfctl.service.app import create_app
from ibfctl.service.fleet import AT_REST
from ibfctl.service.server import Server
from ibfctl.service.settings import Settings

PATIENCE_S = 60.0
OVER = {"done", "failed", *AT_REST}


def ended(client: httpx.Client, place: str) -> dict[str, Any]:
    """Wait until a plan or a run is over, and return its record."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        record: dict[str, Any] = client.get(place).raise_for_status().json()
        if record["state"] in OVER:
            return record
        time.sleep(0.02)
    pytest.fail(f"{place} is still {record}")


@contextmanager
def serving(settings: Settings) -> Iterator[httpx.Client]:
    server = Server(create_app(settings))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # as `ibfctl serve` does
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, name="service")
        thread.start()
        try:
            while not server.started and thread.is_alive():
                time.sleep(0.005)
            with httpx.Client(base_url=f"http://127.0.0.1:{listener.getsockname()[1]}", timeout=30) as client:
                yield client
        finally:
            server.should_exit = True
            thread.join()
