"""Figures of the service in Prometheus' text format: requests, and what the state is when asked."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from resource import RUSAGE_SELF, getrusage

from starlette.types import ASGIApp, Message, Receive, Scope, Send

MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"


@dataclass(frozen=True)
class Metric:
    """One figure now."""

    name: str
    kind: str
    help: str
    samples: Iterable[tuple[dict[str, str], float]]

    def text(self) -> str:
        """Return its lines."""
        lines = [f"# HELP {self.name} {self.help}", f"# TYPE {self.name} {self.kind}"]
        for labels, value in self.samples:
            shown = ",".join(f'{name}="{value}"' for name, value in labels.items())
            lines.append(f"{self.name}{{{shown}}} {value:.10g}" if shown else f"{self.name} {value:.10g}")
        return "\n".join(lines) + "\n"


class Requests:
    """Counts and times requests; streams of events count when they end."""

    def __init__(self) -> None:
        self._count: Counter[tuple[str, int]] = Counter()
        self._seconds: Counter[str] = Counter()

    def note(self, method: str, status: int, duration_s: float) -> None:
        """Count one request."""
        self._count[method, status] += 1
        self._seconds[method] += duration_s  # type: ignore[assignment]

    def metrics(self) -> list[Metric]:
        """Return what was counted, and what the process has used."""
        used = getrusage(RUSAGE_SELF)
        counts = [({"method": method, "status": str(status)}, n) for (method, status), n in self._count.items()]
        seconds = [({"method": method}, value) for method, value in self._seconds.items()]
        return [
            Metric("ibfctl_requests_total", "counter", "Requests answered.", counts),
            Metric("ibfctl_request_seconds_total", "counter", "Time spent on requests.", seconds),
            Metric(
                "ibfctl_cpu_seconds_total", "counter", "Processor time used.", [({}, used.ru_utime + used.ru_stime)]
            ),
            Metric("ibfctl_peak_memory_bytes", "gauge", "Most memory used.", [({}, used.ru_maxrss * 1024)]),
        ]


class Measured:
    """Notes every request of the application below."""

    def __init__(self, app: ASGIApp, requests: Requests) -> None:
        self._app = app
        self._requests = requests

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        status, begun = 500, time.perf_counter()

        async def heard(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._app(scope, receive, heard)
        finally:
            self._requests.note(scope["method"], status, time.perf_counter() - begun)
