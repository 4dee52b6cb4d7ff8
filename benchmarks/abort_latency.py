"""From the abort call to its bytes on the wire, with the stream handle busy and 50 ms late."""

from __future__ import annotations

import socket
import threading
import time
from typing import Any

import numpy as np

from benchmarks._streaming import machine, wave
from ibfctl.errors import ControllerError
from ibfctl.runs.drivers import connect

ABORTS = 200
LATENCY_S = 0.05
GAP_S = 0.02
STREAM_HANDLE = 0
IDLE = {b"_PV": b"255", b"_SC": b"30"}


class _Wire:
    """Answers like an idle controller, the first handle late, and notes when `AB` arrives."""

    def __init__(self) -> None:
        self.arrivals: list[float] = []
        self.listener = socket.create_server(("127.0.0.1", 0))
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def close(self) -> None:
        self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        for thread in self._threads:
            thread.join()

    def _accept(self) -> None:
        for number in range(16):
            try:
                handle, _ = self.listener.accept()
            except OSError:
                return
            handle.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._threads.append(threading.Thread(target=self._serve, args=(handle, number)))
            self._threads[-1].start()

    def _serve(self, handle: socket.socket, number: int) -> None:
        with handle:
            while data := handle.recv(4096):
                if b"AB\r" in data:
                    self.arrivals.append(time.monotonic())
                if number == STREAM_HANDLE:
                    time.sleep(LATENCY_S)
                handle.sendall(b"".join(map(self._answer, data.split(b"\r")[:-1])))

    @staticmethod
    def _answer(command: bytes) -> bytes:
        if command == b"TC1":
            return b" 0\r\n:"
        if not command.startswith(b"MG"):
            return b":"
        values = (IDLE.get(name[:3], b"0") for name in command[3:].split(b","))
        return b" " + b" ".join(values) + b"\r\n:"


def run() -> dict[str, Any]:
    """Abort again and again while another thread keeps the stream handle busy."""
    wire = _Wire()
    bench = machine()
    connection = bench.connection.model_copy(update={"port": wire.listener.getsockname()[1]})
    controller = connect(bench.model_copy(update={"connection": connection}))
    program, done = wave(64, 60), threading.Event()
    controller.prepare_segments(program)

    def keep_busy() -> None:
        while not done.is_set():
            try:
                controller.buffer_status()
                controller.queue_segments(program, 0, 64)
            except ControllerError:
                return

    busy = threading.Thread(target=keep_busy)
    busy.start()
    called = []
    try:
        for _ in range(ABORTS):
            time.sleep(GAP_S)
            called.append(time.monotonic())
            controller.abort()
    finally:
        done.set()
        busy.join()
        controller.close()
        wire.close()
    latency_ms = 1e3 * (np.array(wire.arrivals) - np.array(called))
    metrics = {
        "p50_ms": float(np.percentile(latency_ms, 50)),
        "p99_ms": float(np.percentile(latency_ms, 99)),
        "worst_ms": float(latency_ms.max()),
    }
    return {"metrics": metrics, "targets": {"p99_ms": {"max": 10.0}}}
