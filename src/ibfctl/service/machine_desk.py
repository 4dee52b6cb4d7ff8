"""The machine of the service between runs: one act at a time, and what the last one has seen."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from ibfctl.errors import RunError
from ibfctl.runs.control import URGENT, send
from ibfctl.runs.emulator import EmulatedController
from ibfctl.runs.states import RunState
from ibfctl.service.access import Holder
from ibfctl.service.children import Child
from ibfctl.service.fleet import Beside, Fleet
from ibfctl.service.problems import ServiceError, problem
from ibfctl.service.rescue import HEARD_S, LAST_S, act_without, carry_out, is_true_within
from ibfctl.service.settings import Settings
from ibfctl.service.store import new_identity

ACTS = "acts"
"""Folder of the data folder; `ibfctl abort` looks into it as well."""

Shown = dict[str, Any]


class MachineDesk:
    """Acts on the machine of the service that are no runs.

    Parameters
    ----------
    settings, fleet
        Of the service.
    beside
        Does work beside the requests.
    """

    def __init__(self, settings: Settings, fleet: Fleet, beside: Beside) -> None:
        self._settings = settings
        self._fleet = fleet
        self._beside = beside
        self._folder = settings.data / ACTS
        shutil.rmtree(self._folder, ignore_errors=True)
        self.emulated: EmulatedController | None = None
        self._request: Shown = {}
        self._child: Child | None = None
        self._silent: Shown | None = None
        self.act: Shown | None = None
        self.seen: Shown | None = None

    @property
    def busy(self) -> bool:
        """Whether an act is under way."""
        return self.act is not None and self.act["state"] == "running"

    def start(self, name: str, holder: Holder, target_mm: Mapping[str, float] | None = None) -> None:
        """Begin an act.

        Raises
        ------
        ServiceError
            If a run or another act is under way; an e-stop asks for neither. A run that waits for a tool to be
            mounted has let go of the machine.
        """
        emergency = name == "estop"
        moving = [run for run in self._fleet.living if self._fleet.state(run) is not RunState.TOOL_CHANGE]
        if not emergency and (self.busy or moving):
            what = f"runs/{moving[0]}" if moving else f"machine: {(self.act or {})['name']}"
            raise ServiceError(409, f"{what} is under way", "wait for its end or abort it")
        request: Shown = {"name": name, "machine": str(self._settings.machine), "target_mm": dict(target_mm or {})}
        if self.emulated is not None:
            address = {"host": self.emulated.host, "port": self.emulated.port}
            request |= {"address": address, "speed": self.emulated.time_scale}
        identity = new_identity()
        begun = datetime.now(UTC).isoformat(timespec="milliseconds")
        self.act = {"id": identity, "name": name, "state": "running", "begun": begun, "operator": holder.name}
        self._request, self._child, self._silent = request, None, None
        self._beside(self._do(identity, request))

    def tell(self, act: str, holder: Holder) -> list[str]:
        """Tell an act that is under way to abort or to stop in an emergency; return which was told."""
        if self.act is None or not self.busy:
            return []
        identity = self.act["id"]
        if act in URGENT:
            self._beside(self._see_to(identity, act))
        with contextlib.suppress(RunError):
            send(self._folder / identity, {"act": act, "key": holder.key, "by": holder.name})
            return [identity]
        return []

    async def _see_to(self, identity: str, act: str) -> None:
        """Reach the controller without a process that does not end when it is told, and end that."""

        def ended() -> bool:
            return self.act is None or self.act["id"] != identity or not self.busy

        if await is_true_within(ended, HEARD_S):
            return
        safe = False
        while not safe:
            safe, told = await act_without("the act's process", act, self._folder / new_identity(), self._request)
            self._silent = told
            if not safe and await is_true_within(ended, LAST_S):
                return
        if self._child is not None and not ended():
            self._child.kill()

    async def _do(self, identity: str, request: Shown) -> None:
        def note(child: Child) -> None:
            self._child = child

        event = await carry_out(self._folder / identity, request, note)
        if self._silent is not None:
            event = {"event": "failed", **self._silent}
        ended: Shown = {"state": "done"}
        if event["event"] == "failed":
            ended = {"state": "failed", "error": problem(409, event["code"], event["message"], event["hint"])}
        else:
            self.seen = {**event["figures"], "at": datetime.now(UTC).isoformat(timespec="milliseconds")}
        if self.act is not None and self.act["id"] == identity:
            self.act = {**self.act, **ended}
