"""Conditions that must hold while the beam is on: inputs of the controller, or values that somebody pushes."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Self

from ibfctl.errors import ControllerError
from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import Interlock
from ibfctl.runs.requests import Requests

LOOK_S = 0.1

Report = Callable[[str, Mapping[str, object]], None]


class Interlocks:
    """Watches a run's interlocks from a thread of its own.

    One that leaves its band holds the run: a pause with the gate closed at once. Once it has been in its band for its
    settle time it lets the run go on by itself; without a settle time an operator's resume does.

    Parameters
    ----------
    interlocks
        From the machine file.
    controller, requests
        Where inputs are read, and who is told.
    report
        Told of every change, as ``interlock``.
    """

    def __init__(
        self, interlocks: Sequence[Interlock], controller: MotionController, requests: Requests, report: Report
    ) -> None:
        self._interlocks = interlocks
        self._controller = controller
        self._requests = requests
        self._report = report
        self._since: dict[str, float] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="run-interlocks", daemon=True)
        self.values: dict[str, dict[str, object]] = {}
        """Value and whether it is in its band, by name, as last seen."""

    def __enter__(self) -> Self:
        if self._interlocks:
            self.look()
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        if self._interlocks:
            self._thread.join()

    @property
    def bad(self) -> list[str]:
        """Names of those out of their bands."""
        return [name for name, seen in self.values.items() if not seen["ok"]]

    def look(self) -> None:
        """Read all, hold the run for those that are out of their bands, and let it go for those that have settled."""
        now = time.monotonic()
        for interlock, value in zip(self._interlocks, self._read(), strict=True):
            name = interlock.name
            ok = value is not None and interlock.min <= value <= interlock.max
            before = self.values.get(name, {"ok": True})["ok"]
            self.values[name] = {"value": value, "ok": ok}
            if not ok:
                self._requests.hold(name)
                self._since.pop(name, None)
            elif name in self._requests.held:
                since = self._since.setdefault(name, now)
                if interlock.settle_s is not None and now >= since + interlock.settle_s:
                    self._requests.release(name)
            if ok is not before:
                self._report("interlock", {"name": name, "value": value, "ok": ok})

    def _watch(self) -> None:
        while not self._ended.wait(LOOK_S):
            try:
                self.look()
            except ControllerError:
                return  # the run hears of its link without us, and the guard of a host that is gone

    def _read(self) -> list[float | None]:
        digital = [lock.number for lock in self._interlocks if lock.kind == "digital"]
        analog = [lock.number for lock in self._interlocks if lock.kind == "analog"]
        levels, volts = self._controller.read_inputs(digital, analog) if digital or analog else ([], [])
        pushed = self._requests.pushed
        values: list[float | None] = []
        for lock in self._interlocks:
            if lock.kind == "digital":
                values.append(float(levels[digital.index(lock.number)]))
            elif lock.kind == "analog":
                values.append(volts[analog.index(lock.number)])
            else:
                value, at_s = pushed.get(lock.name, (None, 0.0))
                values.append(value if time.monotonic() <= at_s + lock.stale_s else None)
        return values
