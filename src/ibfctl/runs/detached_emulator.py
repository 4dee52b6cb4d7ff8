"""The emulated controller of a data folder: it outlives whoever started it, as a real one would."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ibfctl.errors import ControllerError
from ibfctl.files import atomic_path
from ibfctl.machine.description import Connection
from ibfctl.runs.emulator import END_TIMEOUT_S, LISTENING, START_TIMEOUT_S, EmulatedController
from ibfctl.runs.launch import let_go
from ibfctl.runs.lock import is_held, lock_path, take
from ibfctl.runs.places import EMULATOR, EMULATOR_LOCK, EMULATOR_LOG

_TICK_S = 0.01


class DetachedEmulator:
    """An emulated controller for all runs of a data folder; made by `start_or_adopt`.

    Attributes
    ----------
    controller
        Where it listens, and how fast its clock runs.
    adopted
        Whether it had been started before.
    """

    def __init__(self, data: Path, controller: EmulatedController, process: subprocess.Popen[bytes] | None) -> None:
        self._data = data
        self._process = process
        self.controller = controller
        self.adopted = process is None

    @classmethod
    def start_or_adopt(
        cls, data: Path, *, speed: float = 1.0, axes: int = 2, trace: Path | None = None
    ) -> DetachedEmulator:
        """Return the emulated controller of a data folder: the one that lives, or a new one.

        One that lives with another speed is ended and replaced, unless a run or an act holds it. A new one writes
        what it executes to `trace`, if that is wanted; the file grows as long as it lives.

        Raises
        ------
        ControllerError
            If it does not start.
        """
        present = running(data)
        if present is not None:
            adopted = cls(data, present, None)
            if present.time_scale == speed or adopted.in_use:
                return adopted
            adopted.end()
        return cls(data, *_start(data, speed, axes, trace))

    @property
    def in_use(self) -> bool:
        """Whether a run or an act holds the controller."""
        connection = Connection(host=self.controller.host, port=self.controller.port)
        return is_held(lock_path(connection))

    def let_go(self) -> None:
        """Leave it running."""
        if self._process is not None:
            let_go(self._process)

    def end(self) -> None:
        """End it in order.

        Raises
        ------
        ControllerError
            If it does not end.
        """
        if is_held(self._data / EMULATOR_LOCK):
            os.kill(_told(self._data)["pid"], signal.SIGTERM)
        deadline = time.monotonic() + END_TIMEOUT_S
        while is_held(self._data / EMULATOR_LOCK):
            if time.monotonic() > deadline:
                raise ControllerError("the emulated controller does not end", "end its process by hand")
            time.sleep(_TICK_S)
        if self._process is not None:
            self._process.wait()
        (self._data / EMULATOR).unlink(missing_ok=True)


def running(data: Path) -> EmulatedController | None:
    """Return the emulated controller of a data folder, if one lives."""
    if not is_held(data / EMULATOR_LOCK):
        return None
    told = _told(data)
    return EmulatedController(told["host"], told["port"], told["time_scale"])


def _told(data: Path) -> dict[str, Any]:
    try:
        told: dict[str, Any] = json.loads((data / EMULATOR).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ControllerError(
            f"an emulated controller holds {data / EMULATOR_LOCK}, but {EMULATOR} does not say where it listens",
            "end that process by hand",
        ) from error
    return told


def _start(
    data: Path, speed: float, axes: int, trace: Path | None
) -> tuple[EmulatedController, subprocess.Popen[bytes]]:
    lock = take(data / EMULATOR_LOCK, f"emulated controller started by process {os.getpid()}")
    if lock is None:
        raise ControllerError("an emulated controller is being started already", "try again")
    command = [sys.executable, "-m", "ibfctl_simulator", "--port", "0", "--axes", str(axes), "--speed", f"{speed:g}"]
    if trace is not None:
        command += ["--trace", str(trace)]
    try:
        (data / EMULATOR).unlink(missing_ok=True)
        with (data / EMULATOR_LOG).open("wb") as log:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                pass_fds=(lock,),
                start_new_session=True,
            )
    finally:
        os.close(lock)
    try:
        controller = EmulatedController(*_await_address(data / EMULATOR_LOG, process), speed)
        with atomic_path(data / EMULATOR) as partial:
            partial.write_text(json.dumps({"pid": process.pid, **asdict(controller)}), encoding="utf-8")
    except BaseException:
        process.kill()
        process.wait()
        raise
    return controller, process


def _await_address(log: Path, process: subprocess.Popen[bytes]) -> tuple[str, int]:
    deadline = time.monotonic() + START_TIMEOUT_S
    while (match := LISTENING.search(log.read_bytes())) is None:
        if process.poll() is not None or time.monotonic() > deadline:
            raise ControllerError(
                f"emulated controller did not start: {log.read_text(errors='replace').strip() or 'no reason given'}",
                "start `ibfctl-simulator` by hand to see why",
            )
        time.sleep(_TICK_S)
    return match["host"].decode("ascii"), int(match["port"])
