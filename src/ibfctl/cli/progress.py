"""Progress on standard error, so that standard output stays clean: a bar on a terminal, else plain lines."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    import rich.progress as bars

Report = Callable[[str, float], None]
_PLAIN_STEP = 0.25


@contextmanager
def progress(*, plain: bool = False) -> Iterator[Report]:
    """Yield a function of a stage's name and the fraction done (0 to 1) that shows how far the work is.

    `plain` writes lines on a terminal too: a bar would be drawn over what is asked meanwhile.
    """
    if sys.stderr.isatty() and not plain:
        try:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
        except ModuleNotFoundError:
            pass
        else:
            columns = (TextColumn("{task.description:<30}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
            with Progress(*columns, console=Console(stderr=True)) as display:
                yield _Bars(display)
                return
    yield _PlainLines()


class _Bars:
    """One bar for every activity; a fraction that falls back begins the next."""

    def __init__(self, display: bars.Progress) -> None:
        self._display = display
        self._task: bars.TaskID | None = None
        self._fraction = 0.0

    def __call__(self, stage: str, fraction: float) -> None:
        if self._task is None or fraction < self._fraction:
            self._task = self._display.add_task(stage, total=1.0)
        self._fraction = fraction
        self._display.update(self._task, description=stage, completed=fraction)


class _PlainLines:
    """One line when a stage begins and at every quarter of it."""

    def __init__(self) -> None:
        self._stage = ""
        self._next = 0.0

    def __call__(self, stage: str, fraction: float) -> None:
        if stage != self._stage:
            self._stage, self._next = stage, 0.0
        if fraction >= self._next:
            click.echo(f"{stage}: {fraction:.0%}", err=True)
            self._next = (fraction // _PLAIN_STEP + 1) * _PLAIN_STEP
