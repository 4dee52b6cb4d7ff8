"""Progress on standard error, so that standard output stays clean: a bar on a terminal, else plain lines."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click

Report = Callable[[str, float], None]
_PLAIN_STEP = 0.25


@contextmanager
def progress() -> Iterator[Report]:
    """Yield a function of a stage's name and its fraction (0 to 1) that shows how far the work is."""
    if sys.stderr.isatty():
        try:
            import rich.progress as bars
            from rich.console import Console
        except ModuleNotFoundError:
            pass
        else:
            columns = (
                bars.TextColumn("{task.description:<24}"),
                bars.BarColumn(),
                bars.TaskProgressColumn(),
                bars.TimeElapsedColumn(),
            )
            with bars.Progress(*columns, console=Console(stderr=True)) as display:
                tasks: dict[str, bars.TaskID] = {}

                def draw(stage: str, fraction: float) -> None:
                    if stage not in tasks:
                        tasks[stage] = display.add_task(stage, total=1.0)
                    display.update(tasks[stage], completed=min(1.0, fraction))

                yield draw
                return
    yield _PlainLines()


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
