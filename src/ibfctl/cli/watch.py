"""A run as it goes: a live display on a terminal, else plain lines."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from ibfctl.client import Client
    from ibfctl.client.records import Run

Told = Mapping[str, Any]
LINE_EVERY_S = 5.0
_BOX = 40


def watch(client: Client, identity: str) -> Run:
    """Show a run until it is over, and return it."""
    from ibfctl.client.records import OVER

    with display() as show:
        run = client.runs.show(identity)
        if run["state"] not in OVER:
            for event in client.events(run=identity, after=0):
                if event["event"] == "telemetry":
                    show(event["data"])
                if event["data"].get("state") in OVER:
                    break
    return client.runs.wait(identity)


def describe(told: Told) -> str:
    """Say a status in one line."""
    parts = [str(told["state"])]
    for name, form in (
        ("progress", "{:.1%}"),
        ("eta_s", "{} to the end"),
        ("eta_pause_s", "{} to the next pause"),
        ("margin_s", "margin {:.2f} s"),
        ("gate", "gate {}"),
        ("residual_rms_nm", "residual {:.3f} nm RMS"),
    ):
        value = told.get(name)
        if value is not None:
            parts.append(form.format(_clock(value) if name.startswith("eta") else value))
    if told.get("executed") is not None and told.get("total"):
        parts.append(f"segment {told['executed']} of {told['total']}")
    if told.get("reason"):
        parts.append(f"{told['reason']}; {told.get('hint') or ''}".rstrip("; "))
    return "  ".join(parts)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


@contextmanager
def display() -> Iterator[Callable[[Told], None]]:
    """Yield a function that shows a status."""
    if sys.stderr.isatty():
        try:
            from rich.console import Console
            from rich.live import Live
        except ModuleNotFoundError:
            pass
        else:
            with Live(console=Console(stderr=True), refresh_per_second=8) as live:
                yield lambda told: live.update(_panel(told))
                return
    yield _PlainLines()


def _panel(told: Told) -> Any:
    from rich.console import Group
    from rich.progress_bar import ProgressBar
    from rich.text import Text

    done = told.get("progress")
    if done is None and told.get("total"):
        done = (told.get("executed") or 0) / told["total"]
    style = {"open": "bold yellow", "closed": "green"}.get(told.get("gate") or "", "red")
    gate = Text(f"beam gate {told.get('gate', 'unknown')}", style=style)
    return Group(Text(describe(told)), ProgressBar(total=1.0, completed=done or 0.0, width=_BOX), gate)


class _PlainLines:
    """One line at every change of state, and every few seconds."""

    def __init__(self) -> None:
        self._state = ""
        self._next = 0.0

    def __call__(self, told: Told) -> None:
        now = time.monotonic()
        if told["state"] != self._state or now >= self._next:
            self._state, self._next = told["state"], now + LINE_EVERY_S
            click.echo(describe(told), err=True)
