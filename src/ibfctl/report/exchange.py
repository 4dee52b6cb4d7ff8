"""A plan as text: its program as plain CSV and in the forms that Galil's PVT tool opens, its path as G-code.

Galil's tool opens `*.pvt.csv` (its segment table) and `*.pvt.dmc` (a controller program with explicit PV
commands); docs/file-formats.md says what is known of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ibfctl.files import atomic_path
from ibfctl.machine.program import PvtProgram
from ibfctl.planning.plan import Plan
from ibfctl.report.gcode import gcode_lines

FORMATS = ("csv", "pvt.csv", "pvt.dmc", "gcode")
_BUFFER_PLACES = 255


def exchange_lines(program: PvtProgram, form: str, title: str) -> Iterator[str]:
    """Yield the lines of a program in one of `FORMATS` but G-code; `title` is for the form that has comments."""
    if form == "csv":
        return _csv(program)
    if form == "pvt.csv":
        return _pvt_csv(program)
    return _pvt_dmc(program, title)


def write_exchange(plan: Plan, form: str, title: str, path: Path) -> None:
    """Write a plan in one of `FORMATS`, completely or not at all."""
    lines = gcode_lines(plan, title) if form == "gcode" else exchange_lines(plan.program, form, title)
    with atomic_path(path) as partial, partial.open("w", encoding="ascii", newline="\n") as stream:
        stream.writelines(f"{line}\n" for line in lines)


def _csv(program: PvtProgram) -> Iterator[str]:
    """One row per node, counts as sent and mm as meant; row 0 is the start at rest."""
    names = ["segment", "time_samples", "time_s"]
    columns: list[list[str]] = []
    samples = np.concatenate([[0], program.time_samples])
    time_s = np.cumsum(samples) * program.sample_period_s
    columns += [[str(row) for row in range(samples.size)], [str(value) for value in samples]]
    columns.append([f"{value:.9f}" for value in time_s])
    for coordinate, letter in sorted(program.coordinates.items()):
        axis = program.axes[letter]
        increment = np.concatenate([[0], axis.increment_counts])
        velocity = np.concatenate([[0], axis.end_velocity_counts_s])
        position = axis.start_counts + np.cumsum(increment)
        names += [
            f"{letter}_increment_counts",
            f"{letter}_end_velocity_counts_s",
            f"{letter}_position_counts",
        ]
        names += [f"{coordinate}_mm", f"v{coordinate}_mm_s"]
        columns += [[str(value) for value in counts] for counts in (increment, velocity, position)]
        columns += [[f"{value / axis.counts_per_mm:.9f}" for value in counts] for counts in (position, velocity)]
    yield ",".join(names)
    for row in zip(*columns, strict=True):
        yield ",".join(row)


def _pvt_csv(program: PvtProgram) -> Iterator[str]:
    """One row per segment: position, velocity and time of every axis side by side, as they are sent."""
    letters = sorted(program.axes)
    yield ",".join(f"{letter} {field}" for letter in letters for field in ("Position", "Velocity", "Time"))
    for segment, samples in enumerate(program.time_samples):
        yield ",".join(
            f"{program.axes[letter].increment_counts[segment]},"
            f"{program.axes[letter].end_velocity_counts_s[segment]},{samples}"
            for letter in letters
        )


def _pvt_dmc(program: PvtProgram, title: str) -> Iterator[str]:
    """PV commands in the order in which they are sent; motion begins once the buffer is full."""
    letters = sorted(program.axes)
    begin_after = min(len(program), _BUFFER_PLACES - 1)
    yield f"REM {title[:70]}"
    for letter in letters:
        yield f"REM axis {letter} starts at {program.axes[letter].start_counts} counts"
        yield f"PV{letter}=0,0,-1"
    for segment, samples in enumerate(program.time_samples):
        if segment == begin_after:
            yield f"BT {''.join(letters)}"
        for letter in letters:
            axis = program.axes[letter]
            yield f"PV{letter}={axis.increment_counts[segment]},{axis.end_velocity_counts_s[segment]},{samples}"
    yield from (f"PV{letter}=0,0,0" for letter in letters)
    if begin_after == len(program):
        yield f"BT {''.join(letters)}"
    yield "EN"
