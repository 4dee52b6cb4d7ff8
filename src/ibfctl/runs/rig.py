"""What every step of a run works with."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from ibfctl.errors import ControllerError
from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import MachineDescription
from ibfctl.runs.requests import Requests
from ibfctl.runs.sentinel import Sentinel

WAKE_UP_S = 0.003


@dataclass
class Rig:
    """A connected machine, and who watches it.

    Attributes
    ----------
    machine, controller, requests, sentinel
        What moves, who moves it, what is wanted, and who acts when nobody else does.
    time_scale
        Controller seconds per host second: 1, but for an emulated clock.
    poll_interval_s
        Longest pause between two polls of the controller, on the host's clock.
    reserve_s
        How long before the last moment, on the host's clock, the sentinel must begin to close the gate.
    guarded
        Set while our guard runs on the controller: then it is told that this host lives.
    gate
        What `make_safe` has made of it: `closed`, or `unknown` where it could not be closed; None before.
    """

    machine: MachineDescription
    controller: MotionController
    requests: Requests
    sentinel: Sentinel
    time_scale: float = 1.0
    poll_interval_s: float = 0.05
    reserve_s: float = 0.0
    guarded: threading.Event = field(default_factory=threading.Event)
    gate: str | None = None

    @contextmanager
    def on_guard(self) -> Iterator[None]:
        """Start the guard; from now on it has signs of life, until somebody else sees to the gate."""
        self.controller.start_guard(self.patience_s)
        self.guarded.set()
        try:
            yield
        finally:
            self.guarded.clear()
            self.controller.limit_replies(None)

    def expect_prompt_replies(self) -> None:
        """Do not wait for a silent controller any longer than its guard would wait for a silent host."""
        self.controller.limit_replies(self.machine.beam_gate.guard_patience_s)

    def close_gate_timed(self) -> None:
        """Close the gate, and learn how long that takes."""
        asked_at = time.monotonic()
        self.controller.close_gate()
        self.reserve_s = 2 * (time.monotonic() - asked_at) + WAKE_UP_S

    @property
    def patience_s(self) -> float:
        """How long the guard waits for a sign of life, in controller seconds."""
        return self.machine.beam_gate.guard_patience_s * self.time_scale

    def make_safe(self) -> str:
        """Close the gate, then stop the axes; return what could not be done, or nothing."""
        self.gate = "unknown"
        try:
            self.controller.close_gate()
        except ControllerError as error:
            return str(error.message)  # a stop with the beam on would drill a hole; the buffer ends the motion
        self.gate = "closed"
        try:
            self.controller.stop()
            self.controller.stop_guard()
        except ControllerError:
            try:
                self.controller.abort()
            except ControllerError as error:
                return f"the gate is closed, but the axes may move until their buffer is empty ({error.message})"
        return ""
