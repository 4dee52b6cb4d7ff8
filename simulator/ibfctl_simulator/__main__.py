"""Command line of the emulated controller."""

from __future__ import annotations

import argparse
import asyncio
import dataclasses
import os
import signal
import stat
import sys
from collections.abc import Sequence
from pathlib import Path

from ibfctl_simulator.galil import control
from ibfctl_simulator.galil.clock import ScaledClock, SteppedClock
from ibfctl_simulator.galil.control_port import ControlPort
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.programs.memory import Program
from ibfctl_simulator.galil.server import Emulator
from ibfctl_simulator.galil.settings import SAMPLES_PER_SECOND, Settings
from ibfctl_simulator.galil.state import LETTERS
from ibfctl_simulator.galil.trace import TraceWriter
from ibfctl_simulator.options import parser
from ibfctl_simulator.settings_file import read_settings

FAILED = 2


class _UserError(Exception):
    """Something that the caller can correct; the message is all that is shown."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the emulator until it is told to end; returns the exit code."""
    options = parser().parse_args(arguments)
    try:
        settings = _settings(options)
        program = _program(options.program)
        trace = _trace(options.trace, settings)
        try:
            asyncio.run(_serve(options, Controller(settings, trace, program)))
        finally:
            if trace is not None:
                trace.close()
    except _UserError as error:
        print(f"ibfctl-simulator: {error}", file=sys.stderr)
        return FAILED
    return 0


def _settings(options: argparse.Namespace) -> Settings:
    settings = Settings()
    if options.settings is not None:
        try:
            settings = read_settings(options.settings)
        except (OSError, ValueError) as error:
            raise _UserError(f"settings file {options.settings}: {error}; correct it") from error
    chosen = {"axes": options.axes, "family": options.model}
    return dataclasses.replace(settings, **{name: value for name, value in chosen.items() if value is not None})


def _program(path: Path | None) -> Program:
    if path is None:
        return Program()
    try:
        return Program(path.read_text(encoding="latin-1").splitlines())
    except OSError as error:
        raise _UserError(f"program {path}: {_reason(error)}; choose another file with --program") from error
    except CommandError as error:
        raise _UserError(f"program {path}: error {error}; correct the program") from error


def _trace(path: Path | None, settings: Settings) -> TraceWriter | None:
    if path is None:
        return None
    try:
        return TraceWriter(path, LETTERS[: settings.axes], 1.0 / SAMPLES_PER_SECOND)
    except OSError as error:
        raise _UserError(f"trace file {path}: {_reason(error)}; choose another path with --trace") from error


async def _serve(options: argparse.Namespace, controller: Controller) -> None:
    clock = SteppedClock() if options.clock == "stepped" else ScaledClock(options.speed)
    emulator = Emulator(controller, clock)
    back_door = ControlPort(emulator)
    try:
        await emulator.start(options.host, options.port)
    except OSError as error:
        where = f"{options.host}:{options.port}"
        raise _UserError(f"cannot listen on {where}: {_reason(error)}; choose another --host or --port") from error
    try:
        for fault in options.fault:
            try:
                control.apply_command(emulator, fault)
            except ValueError as error:
                raise _UserError(f"--fault {fault!r}: {error}") from error
        if options.control_port is not None:
            await _open_back_door(options, back_door)
        print(f"listening on {emulator.host}:{emulator.port}", flush=True)
        if options.control_port is not None:
            print(f"control on {emulator.host}:{back_door.port}", flush=True)
        await _until_told_to_end(options, emulator)
    finally:
        back_door.stop()
        emulator.catch_up()
        await emulator.stop()


async def _open_back_door(options: argparse.Namespace, back_door: ControlPort) -> None:
    try:
        await back_door.start(options.host, options.control_port)
    except OSError as error:
        where = f"{options.host}:{options.control_port}"
        raise _UserError(f"cannot listen on {where}: {_reason(error)}; choose another --control-port") from error


async def _until_told_to_end(options: argparse.Namespace, emulator: Emulator) -> None:
    end = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, end.set)
    if options.exit_with_parent:
        _watch_standard_input(loop, end)
    ending = loop.create_task(end.wait())
    try:
        await asyncio.wait({ending, emulator.ticking}, return_when=asyncio.FIRST_COMPLETED)
        if emulator.ticking.done():
            emulator.ticking.result()
    finally:
        ending.cancel()


def _watch_standard_input(loop: asyncio.AbstractEventLoop, end: asyncio.Event) -> None:
    """End when the pipe on standard input closes; other kinds of standard input cannot tell."""
    if sys.stdin is None:
        return
    descriptor = sys.stdin.fileno()
    mode = os.fstat(descriptor).st_mode
    if not (stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)):
        return

    def read() -> None:
        if not os.read(descriptor, 4096):
            loop.remove_reader(descriptor)
            end.set()

    loop.add_reader(descriptor, read)


def _reason(error: OSError) -> str:
    return os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)


if __name__ == "__main__":
    sys.exit(main())
