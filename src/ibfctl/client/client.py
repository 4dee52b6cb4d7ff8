"""`Client`: the resources of one service."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, Self, TypeVar, cast

from ibfctl.client.records import OVER, Event, Influence, Machine, MachineNow, Map, Plan, PlanProgress, Resource, Run
from ibfctl.client.transport import Transport

DEFAULT_URL = "http://127.0.0.1:8000"
_POLL_S = 0.2
_SUFFIXES = {"txt": "csv", "fit": "fits", "tiff": "tif"}

R = TypeVar("R", bound=Resource)


class Collection(Generic[R]):
    """All resources of one kind."""

    def __init__(self, transport: Transport, kind: str) -> None:
        self._transport = transport
        self._place = f"/v1/{kind}"

    def list(self) -> Iterator[R]:
        """Yield all, oldest first."""
        place: str | None = self._place
        while place is not None:
            page = self._transport.ask("GET", place)
            yield from page["items"]
            place = page.get("next")

    def show(self, identity: str) -> R:
        """Return one."""
        return cast(R, self._transport.ask("GET", f"{self._place}/{identity}"))

    def delete(self, identity: str) -> None:
        """Delete one that nothing refers to."""
        self._transport.ask("DELETE", f"{self._place}/{identity}")

    def download(self, identity: str, name: str, path: str | Path) -> Path:
        """Write one of its files, named in its `links`, to `path`."""
        self._transport.download(f"{self._place}/{identity}/files/{name}", Path(path))
        return Path(path)

    def _act(self, identity: str, act: str, **body: Any) -> R:
        return cast(R, self._transport.ask("POST", f"{self._place}/{identity}/{act}", json=body or None))


class Maps(Collection[Map]):
    """Surface maps."""

    def add(
        self, path: str | Path, *, pixel_mm: float | None = None, unit: str | None = None, array: str | None = None
    ) -> Map:
        """Upload a map; pixel size, unit and array where the file does not say them."""
        asked: dict[str, Any] = {"format": _format(path), "pixel_mm": pixel_mm, "unit": unit, "array": array}
        return cast(Map, self._transport.upload(self._place, Path(path), asked))


class Influences(Collection[Influence]):
    """Tool influence functions."""

    def add(self, spec: str | Path, *, pixel_mm: float | None = None, unit: str | None = None) -> Influence:
        """Upload an influence function, or give a formula (``gaussian:...``)."""
        if ":" in str(spec) and "=" in str(spec):
            formula = {"formula": str(spec), **({} if pixel_mm is None else {"pixel_mm": pixel_mm})}
            return cast(Influence, self._transport.ask("POST", self._place, params=formula))
        asked = {"format": _format(spec), "pixel_mm": pixel_mm, "unit": unit}
        return cast(Influence, self._transport.upload(self._place, Path(spec), asked))


class Machines(Collection[Machine]):
    """Machine files."""

    def add(self, path: str | Path) -> Machine:
        """Add a machine file."""
        return cast(Machine, self._transport.upload(self._place, Path(path), {}))


class Plans(Collection[Plan]):
    """Plans."""

    def create(self, map_id: str, influence_id: str | None = None, **options: Any) -> Plan:
        """Start planning; options as in docs/rest.md, e.g. ``pitch_mm=1.0``, or ``tools=[..]`` instead of one tool."""
        tool = {} if influence_id is None else {"influence_id": influence_id}
        return cast(Plan, self._transport.ask("POST", self._place, json={"map_id": map_id, **tool, **options}))

    def add(self, path: str | Path, machine_id: str | None = None) -> Plan:
        """Upload a plan file that was made elsewhere, e.g. of the rest of a run; the machine runs it."""
        asked = {} if machine_id is None else {"machine_id": machine_id}
        return cast(Plan, self._transport.upload("/v1/plan-files", Path(path), asked))

    def cancel(self, identity: str) -> Plan:
        """Cancel the planning."""
        return self._act(identity, "cancel")

    def wait(self, identity: str, on_progress: Callable[[PlanProgress], None] = lambda progress: None) -> Plan:
        """Wait until a plan is done or has failed, and return it."""
        while (plan := self.show(identity))["state"] in ("queued", "running"):
            if "progress" in plan:
                on_progress(plan["progress"])
            time.sleep(_POLL_S)
        return plan


class Runs(Collection[Run]):
    """Runs."""

    def start(self, plan_id: str, operator: str | None = None) -> Run:
        """Start a run of a plan that is done."""
        return cast(Run, self._transport.ask("POST", self._place, json={"plan_id": plan_id, "operator": operator}))

    def pause(self, identity: str, *, now: bool = False) -> Run:
        """Pause at the next safe point, or with the gate closed now."""
        return self._act(identity, "pause", when="now" if now else "safe-point")

    def resume(self, identity: str) -> Run:
        """Go on after a pause."""
        return self._act(identity, "resume")

    def recover(self, identity: str) -> Run:
        """Ask the controller again what a run has executed that did not end as planned."""
        return self._act(identity, "recover")

    def stop(self, identity: str) -> Run:
        """Close the gate and decelerate to rest."""
        return self._act(identity, "stop")

    def abort(self, identity: str) -> Run:
        """Close the gate and stop all motion at once."""
        return self._act(identity, "abort")

    def estop(self, identity: str) -> Run:
        """Abort, switch the motors off, and let nothing move until the controller's power was off."""
        return self._act(identity, "estop")

    def confirm(self, identity: str) -> Run:
        """Confirm what the run waits for."""
        return self._act(identity, "confirm")

    def interlock(self, identity: str, name: str, value: float) -> Run:
        """Push the value of an interlock."""
        return self._act(identity, "interlock", name=name, value=value)

    def wait(self, identity: str) -> Run:
        """Wait until a run is over, and return it."""
        while (run := self.show(identity))["state"] not in OVER:
            time.sleep(_POLL_S)
        return run


class MachineOfService:
    """The machine of the service between runs; every act waits for its end."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def show(self) -> MachineNow:
        """Return what is known of it."""
        return cast(MachineNow, self._transport.ask("GET", "/v1/machine"))

    def connect(self) -> MachineNow:
        """Ask the controller who it is and how all stands."""
        return self._do("connect")

    def home(self) -> MachineNow:
        """Home all axes."""
        return self._do("home")

    def move(self, x_mm: float | None = None, y_mm: float | None = None) -> MachineNow:
        """Move to a place in coordinates of the machine."""
        given = {"x_mm": x_mm, "y_mm": y_mm}
        return self._do("move", **{name: place for name, place in given.items() if place is not None})

    def gate_test(self) -> MachineNow:
        """Close the gate, read it back, and see the guard program run."""
        return self._do("gate-test")

    def estop(self) -> MachineNow:
        """Stop everything and latch that on the controller."""
        return self._do("estop")

    def _do(self, act: str, **body: float) -> MachineNow:
        now: MachineNow = self._transport.ask("POST", f"/v1/machine/{act}", json=body or None)
        while "act" in now and now["act"]["state"] == "running":
            time.sleep(_POLL_S)
            now = self.show()
        return now


class Client:
    """One service.

    Parameters
    ----------
    url
        Where it is.
    key
        Token of `ibfctl keys add`, if the service has keys.
    timeout_s
        Longest wait for an answer.

    Attributes
    ----------
    url
        Where it is.
    maps, influences, machines, plans, runs, machine
        Its resources.
    """

    def __init__(self, url: str = DEFAULT_URL, key: str | None = None, timeout_s: float = 60.0) -> None:
        self._transport = Transport(url, key, timeout_s)
        self.url = url
        self.maps = Maps(self._transport, "maps")
        self.influences = Influences(self._transport, "influences")
        self.machines = Machines(self._transport, "machines")
        self.machine = MachineOfService(self._transport)
        self.plans = Plans(self._transport, "plans")
        self.runs = Runs(self._transport, "runs")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close all connections."""
        self._transport.close()

    def info(self) -> dict[str, Any]:
        """Return version, machine and runs under way."""
        return cast(dict[str, Any], self._transport.ask("GET", "/v1/info"))

    def abort(self) -> list[str]:
        """Abort whatever runs; return the runs that were told to."""
        return cast(list[str], self._transport.ask("POST", "/v1/abort")["runs"])

    def events(self, run: str | None = None, after: int | None = None, *, follow: bool = True) -> Iterator[Event]:
        """Yield events as they come, after a replay of the journal from `after`; of one run alone if it is given."""
        return self._transport.events({} if run is None else {"run": run}, after, follow=follow)


def _format(path: str | Path) -> str:
    suffix = Path(path).suffix.removeprefix(".").lower()
    return _SUFFIXES.get(suffix, suffix)
