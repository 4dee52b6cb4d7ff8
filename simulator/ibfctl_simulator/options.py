"""Options of the command line."""

from __future__ import annotations

import argparse
from pathlib import Path


def parser() -> argparse.ArgumentParser:
    """Return the parser of `ibfctl-simulator`."""
    made = argparse.ArgumentParser(
        prog="ibfctl-simulator",
        description="Emulated Galil controller on TCP. Prints 'listening on HOST:PORT' when it is ready.",
    )
    add = made.add_argument
    add("--host", default="127.0.0.1", help="address to listen on (default %(default)s)")
    add("--port", type=_port, default=5023, help="TCP port, 0 for a free one (default %(default)s)")
    add("--axes", type=_axes, help="number of axes, 1 to 8 (default 2)")
    add("--model", choices=("40x0", "41x3"), help="model family (default 40x0)")
    add("--speed", type=_speed, default=1.0, help="simulated seconds per second (default %(default)s)")
    add(
        "--clock",
        choices=("running", "stepped"),
        default="running",
        help="stepped: time passes only by `step samples=N` on the control port (default %(default)s)",
    )
    add("--trace", type=Path, metavar="FILE", help="write every sample of motion (counts) to this HDF5 file")
    add("--settings", type=Path, metavar="FILE", help="TOML file with settings of the controller")
    add("--program", type=Path, metavar="FILE", help="burned DMC program; its #AUTO runs at once")
    add("--control-port", type=_port, metavar="PORT", help="port of the back door for faults, 0 for a free one")
    add(
        "--fault",
        action="append",
        default=[],
        metavar="LINE",
        help="a line of the back door, e.g. 'delay seconds=0.05'; may be repeated",
    )
    add("--exit-with-parent", action="store_true", help="end when the pipe on standard input closes")
    return made


def _port(text: str) -> int:
    return _within(int(text), 0, 65535, "a port")


def _axes(text: str) -> int:
    return _within(int(text), 1, 8, "a number of axes")


def _within(value: int, low: int, high: int, what: str) -> int:
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"{value} is not {what} between {low} and {high}")
    return value


def _speed(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value
