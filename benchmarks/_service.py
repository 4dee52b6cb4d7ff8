"""The service as its own process, a job for it, and a wire that notes when an abort passes."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Self

import httpx
import numpy as np

from ibfctl.client import Client
from ibfctl.client.records import OVER
from ibfctl.machine.shipped import shipped_machine
from ibfctl.runs.emulator import emulated_controller

HOURS = "gaussian:fwhm_mm=1.6,peak_nm_s=0.01,radius_mm=2"
START_TIMEOUT_S = 120.0
_CHUNK = 1 << 16


class Wire:
    """Passes bytes between worker and emulated controller, and notes when ``AB`` passes."""

    def __init__(self, port: int) -> None:
        self._target = ("127.0.0.1", port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self.aborts: list[float] = []
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    def close(self) -> None:
        """Take no more connections; those that are open end with their ends."""
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._threads[0].join()

    def await_abort(self, after_s: float) -> float:
        """Return when the first abort after a moment passed."""
        deadline = time.monotonic() + START_TIMEOUT_S
        while not (passed := [at for at in self.aborts if at > after_s]):
            if time.monotonic() > deadline:
                raise TimeoutError("no abort has reached the controller")
            time.sleep(0.002)
        return passed[0]

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            far = socket.create_connection(self._target)
            for end in (near, far):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=self._pass_on, args=(source, sink, source is near), daemon=True).start()

    def _pass_on(self, source: socket.socket, sink: socket.socket, from_worker: bool) -> None:
        try:
            while data := source.recv(_CHUNK):
                if from_worker and b"AB\r" in data:
                    self.aborts.append(time.monotonic())
                sink.sendall(data)
        except OSError:
            pass
        finally:
            for end in (source, sink):
                with suppress(OSError):  # the other direction may have been faster
                    end.shutdown(socket.SHUT_RDWR)
                end.close()


@contextmanager
def service(folder: Path, *options: str) -> Iterator[tuple[Client, int]]:
    """Run a service as an operator does; yield a client of it and its process id."""
    command = [sys.executable, "-m", "ibfctl", "serve", "--port", "0", "--data", str(folder / "data"), *options]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None  # made with a pipe
            said = process.stderr.readline()
            address = re.search(r"http://\S+:\d+", said)
            if address is None:
                raise RuntimeError(said)
            with Client(address[0]) as client:
                yield client, process.pid
        finally:
            process.terminate()


@contextmanager
def service_on_a_wire(folder: Path) -> Iterator[tuple[Client, int, Wire]]:
    """Run a service whose machine is an emulated controller behind a wire."""
    with ExitStack() as resources:
        emulated = resources.enter_context(emulated_controller(None))
        wire = Wire(emulated.port)
        resources.callback(wire.close)
        machine = folder / "machine.toml"
        text = shipped_machine("simulator").read_text(encoding="utf-8")
        machine.write_text(re.sub(r"(?m)^port = \d+", f"port = {wire.port}", text), encoding="utf-8")
        client, process = resources.enter_context(service(folder, "--machine", str(machine)))
        yield client, process, wire


def plan_of_hours(client: Client, folder: Path) -> str:
    """Plan a small part with a weak beam; return the plan's id."""
    y, x = np.mgrid[-1:1:32j, -1:1:48j]
    path = folder / "map.npz"
    np.savez(path, height_nm=8 * x**2 + 5 * y**2 * x + 2 * np.cos(5 * x), pixel_mm=0.25)
    surface, influence = client.maps.add(path), client.influences.add(HOURS)
    plan = client.plans.create(surface["id"], influence["id"], pitch_mm=1.0, step_mm=1.0)
    plan = client.plans.wait(plan["id"])
    if plan["state"] != "done":
        raise RuntimeError(plan)
    return plan["id"]


class Planners:
    """Keep some plans being solved, one after the other, until the end of the block.

    Attributes
    ----------
    looks, busy
        How often it was looked whether all of them are, and how often they were.
    """

    def __init__(self, client: Client, folder: Path, number: int) -> None:
        self._client = client
        self._folder = folder
        self._solving = [_solve(client, folder) for _ in range(number)]
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._keep)
        self.looks = self.busy = 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        for plan in self._solving:
            self._client.plans.cancel(plan)

    def _keep(self) -> None:
        while not self._ended.wait(1.0):
            states = [self._client.plans.show(plan)["state"] for plan in self._solving]
            self.looks += 1
            self.busy += all(state in ("queued", "running") for state in states)
            for place, state in enumerate(states):
                if state == "failed":
                    raise RuntimeError(self._client.plans.show(self._solving[place]))
                if state == "done":
                    self._solving[place] = _solve(self._client, self._folder)


def _solve(client: Client, folder: Path) -> str:
    """Begin a plan that is solved for some time; return its id."""
    y, x = np.mgrid[-1:1:400j, -1:1:400j]
    path = folder / "large.npz"
    np.savez(path, height_nm=50 * x**2 + 20 * np.sin(9 * x * y), pixel_mm=0.1)
    surface = client.maps.add(path)
    influence = client.influences.add("gaussian:fwhm_mm=2,peak_nm_s=4,radius_mm=2.5")
    plan = client.plans.create(surface["id"], influence["id"], pitch_mm=0.15, step_mm=0.15)
    return plan["id"]


def moving_run(client: Client, plan: str) -> str:
    """Start a run and wait until its gate is open; return its id."""
    run = client.runs.start(plan)["id"]
    deadline = time.monotonic() + START_TIMEOUT_S
    while (record := client.runs.show(run))["state"] != "running" or record.get("status", {}).get("gate") != "open":
        if record["state"] in OVER or time.monotonic() > deadline:
            raise RuntimeError(record)
        time.sleep(0.02)
    return run


def percentiles_ms(seconds: list[float]) -> dict[str, float]:
    """Return median, 99th percentile and maximum in ms."""
    values = 1e3 * np.array(seconds)
    return {
        "p50_ms": float(np.percentile(values, 50)),
        "p99_ms": float(np.percentile(values, 99)),
        "worst_ms": float(values.max()),
    }


class Listeners:
    """Read all events of a service on many connections, in a thread each."""

    def __init__(self, url: str, number: int) -> None:
        self._url = url
        self._ended = threading.Event()
        self._counts = [0] * number
        self._threads = [threading.Thread(target=self._listen, args=(place,)) for place in range(number)]

    @property
    def samples(self) -> int:
        """Telemetry heard by all together."""
        return sum(self._counts)

    @property
    def listening(self) -> int:
        """How many of them still listen."""
        return sum(thread.is_alive() for thread in self._threads)

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        for thread in self._threads:
            thread.join()

    def _listen(self, place: int) -> None:
        with httpx.stream("GET", f"{self._url}/v1/events", timeout=30) as stream:
            for chunk in stream.iter_bytes():
                self._counts[place] += chunk.count(b"event: telemetry")
                if self._ended.is_set():
                    return
