"""Command line of the emulated controller."""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
import stat
import sys
from collections.abc import Sequence
from pathlib import Path

from ibfctl_simulator.galil.clock import ScaledClock
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.server import Emulator
from ibfctl_simulator.galil.settings import SAMPLES_PER_SECOND, Settings
from ibfctl_simulator.galil.state import LETTERS
from ibfctl_simulator.galil.trace import TraceWriter

FAILED = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the emulator until it is told to end; returns the exit code."""
    options = _parser().parse_args(arguments)
    settings = Settings(axes=options.axes)
    trace = None
    if options.trace is not None:
        try:
            trace = TraceWriter(options.trace, LETTERS[: settings.axes], 1.0 / SAMPLES_PER_SECOND)
        except OSError as error:
            return _fail(f"trace file {options.trace}: {_reason(error)}; choose another path with --trace")
    try:
        asyncio.run(_serve(options, Controller(settings, trace)))
    except OSError as error:
        where = f"{options.host}:{options.port}"
        return _fail(f"cannot listen on {where}: {_reason(error)}; choose another --host or --port")
    finally:
        if trace is not None:
            trace.close()
    return 0


async def _serve(options: argparse.Namespace, controller: Controller) -> None:
    emulator = Emulator(controller, ScaledClock(options.speed))
    await emulator.start(options.host, options.port)
    end = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, end.set)
    if options.exit_with_parent:
        _watch_standard_input(loop, end)
    print(f"listening on {emulator.host}:{emulator.port}", flush=True)
    ending = loop.create_task(end.wait())
    try:
        await asyncio.wait({ending, emulator.ticking}, return_when=asyncio.FIRST_COMPLETED)
        if emulator.ticking.done():
            emulator.ticking.result()
    finally:
        ending.cancel()
        emulator.catch_up()
        await emulator.stop()


def _watch_standard_input(loop: asyncio.AbstractEventLoop, end: asyncio.Event) -> None:
    """End when the pipe on standard input closes; other kinds of standard input cannot tell."""
    descriptor = sys.stdin.fileno()
    mode = os.fstat(descriptor).st_mode
    if not (stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)):
        return

    def read() -> None:
        if not os.read(descriptor, 4096):
            loop.remove_reader(descriptor)
            end.set()

    loop.add_reader(descriptor, read)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ibfctl-simulator",
        description="Emulated Galil controller on TCP. Prints 'listening on HOST:PORT' when it is ready.",
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default %(default)s)")
    parser.add_argument(
        "--port", type=_port, default=5023, help="TCP port, 0 for a free one (default %(default)s)"
    )
    parser.add_argument("--axes", type=_axes, default=2, help="number of axes, 1 to 8 (default %(default)s)")
    parser.add_argument(
        "--speed", type=_speed, default=1.0, help="simulated seconds per second (default %(default)s)"
    )
    parser.add_argument(
        "--trace", type=Path, metavar="FILE", help="write every sample of motion (counts) to this HDF5 file"
    )
    parser.add_argument(
        "--exit-with-parent", action="store_true", help="end when the pipe on standard input closes"
    )
    return parser


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


def _reason(error: OSError) -> str:
    return os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)


def _fail(message: str) -> int:
    print(f"ibfctl-simulator: {message}", file=sys.stderr)
    return FAILED


if __name__ == "__main__":
    sys.exit(main())
