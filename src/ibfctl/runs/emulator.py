"""The emulated controller as a process of its own, ended so that its trace is complete."""

from __future__ import annotations

import os
import re
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from ibfctl.errors import ControllerError
from ibfctl.machine.description import MachineDescription

START_TIMEOUT_S = 30.0
END_TIMEOUT_S = 30.0
EMULATED_PATIENCE_S = 2.0

LISTENING = re.compile(rb"listening on (?P<host>\S+):(?P<port>\d+)\s*\n")


@dataclass(frozen=True)
class EmulatedController:
    """Where an emulated controller listens, and how fast its clock runs."""

    host: str
    port: int
    time_scale: float

    def in_place_of(self, machine: MachineDescription) -> MachineDescription:
        """Return `machine` with the emulated controller instead of its own.

        Its encoders are absolute, and its guard bears with a computer that is busy with the emulated controller too.
        """
        address = {"host": self.host, "port": self.port, "serial": None}
        connection = machine.connection.model_copy(update=address)
        homing = machine.homing.model_copy(update={"method": "absolute"})
        patience_s = max(machine.beam_gate.guard_patience_s, EMULATED_PATIENCE_S)
        gate = machine.beam_gate.model_copy(update={"guard_patience_s": patience_s})
        return machine.model_copy(update={"connection": connection, "homing": homing, "beam_gate": gate})


@contextmanager
def emulated_controller(
    trace: Path | None, *, speed: float = 1.0, axes: int = 2, faults: Sequence[str] = ()
) -> Iterator[EmulatedController]:
    """Run an emulated controller for the length of a ``with`` block; afterwards `trace` is complete.

    Parameters
    ----------
    trace
        File to which the emulated controller writes what it executed, if that is wanted.
    speed
        Controller seconds per second of the host.
    axes
        Number of axes.
    faults
        What is to go wrong from the start, in the emulated controller's own words, e.g.
        ``delay seconds=0.005``.

    Raises
    ------
    ControllerError
        If it does not start, or does not end in an orderly way.
    """
    command = [sys.executable, "-m", "ibfctl_simulator", "--port", "0", "--axes", str(axes)]
    command += ["--speed", f"{speed:g}", "--exit-with-parent"]
    for fault in faults:
        command += ["--fault", fault]
    if trace is not None:
        command += ["--trace", str(trace)]
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            bufsize=0,
            start_new_session=True,  # Ctrl-C must not end it before the host has closed the gate
        )
        with process:
            try:
                host, port = _await_address(process, errors)
                yield EmulatedController(host, port, speed)
            finally:
                _end(process)
        if process.returncode != 0:
            raise ControllerError(
                f"emulated controller ended with code {process.returncode}: {_last_words(errors)}",
                "the trace may be incomplete; run again",
            )


def _await_address(process: subprocess.Popen[bytes], errors: IO[bytes]) -> tuple[str, int]:
    assert process.stdout is not None  # Popen was given a pipe
    deadline = time.monotonic() + START_TIMEOUT_S
    said = b""
    while (match := LISTENING.search(said)) is None:
        readable, _, _ = select.select([process.stdout], [], [], max(deadline - time.monotonic(), 0.0))
        chunk = os.read(process.stdout.fileno(), 4096) if readable else b""
        if not chunk:
            raise ControllerError(
                f"emulated controller did not start: {_last_words(errors)}",
                "start `ibfctl-simulator` by hand to see why",
            )
        said += chunk
    return match["host"].decode("ascii"), int(match["port"])


def _last_words(errors: IO[bytes]) -> str:
    errors.seek(0)
    lines = errors.read().decode("utf-8", "replace").strip().splitlines()
    return lines[-1] if lines else "no reason given"


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(END_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
