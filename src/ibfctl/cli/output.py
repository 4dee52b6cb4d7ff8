"""What verbs print: one JSON object, or lines of name, value and unit."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from ibfctl.errors import InputError
from ibfctl.files import check_replaceable


def print_json(figures: Mapping[str, Any]) -> None:
    """Print one object; a value that is no finite number becomes null, because JSON has no NaN."""
    click.echo(json.dumps(_finite(figures), indent=2))


def print_lines(lines: Sequence[tuple[str, str]]) -> None:
    """Print names and values in two columns."""
    width = max(len(name) for name, _ in lines)
    for name, value in lines:
        click.echo(f"{name:<{width}}  {value}".rstrip())


def print_table(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> None:
    """Print some fields of every row under their names; nothing at all where there are no rows."""
    shown = [["" if row.get(name) is None else str(row[name]) for name in columns] for row in rows]
    if shown:
        widths = [max(map(len, column)) for column in zip(columns, *shown, strict=True)]
        for line in (columns, *shown):
            click.echo("  ".join(f"{text:<{width}}" for text, width in zip(line, widths, strict=True)).rstrip())


def check_writable(path: Path, *inputs: Path | str | None) -> None:
    """Refuse an output path before the work begins, not after; none may take the place of what is read."""
    check_replaceable(path)
    if not path.absolute().parent.is_dir():
        raise InputError(f"output {path}: its folder does not exist", "make the folder first, or give another path")
    if path.exists() and os.path.realpath(path) in {os.path.realpath(given) for given in inputs if given is not None}:
        raise InputError(f"output {path}: would take the place of what is read", "give another path")


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
