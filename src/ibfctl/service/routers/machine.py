"""The machine of the service itself: look at it, home it, move it, prove its gate, stop it."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Annotated, Any, Self

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field, model_validator

from ibfctl.errors import RunError
from ibfctl.service.access import Holder
from ibfctl.service.models import MachineNow, Told
from ibfctl.service.part import Finite
from ibfctl.service.requests import refusals
from ibfctl.service.state import Asking, Service, State

router = APIRouter(prefix="/machine", tags=["machine"])
everything = APIRouter(tags=["machine"])
_Place = Annotated[Finite, Field(default=None, description="Coordinate of the machine; absent: stays.")]
_ACT: dict[str, Any] = {
    "status_code": 202,
    "response_model": MachineNow,
    "response_model_exclude_none": True,
    "responses": refusals(409),
}


class MoveRequest(BaseModel):
    """Where to move."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"minProperties": 1, "examples": [{"x_mm": 10.0, "y_mm": -2.5}]}
    )

    x_mm: _Place
    y_mm: _Place

    @model_validator(mode="after")
    def _somewhere(self) -> Self:
        if not self.model_fields_set:
            raise ValueError("give x_mm, y_mm, or both")
        return self


@router.get("", response_model=MachineNow, response_model_exclude_none=True, responses=refusals())
async def show_machine_now(service: Service) -> dict[str, Any]:
    """Show what is known of the machine: the act under way, and what the last one saw. Asks the controller nothing."""
    return _shown(service)


@router.post("/connect", **_ACT)
async def connect_machine(service: Service, asking: Asking) -> dict[str, Any]:
    """Ask the controller who it is, where the axes are, how the gate stands, and measure its clock."""
    return await _begin(service, "connect", asking)


@router.post("/home", **_ACT)
async def home_machine(service: Service, asking: Asking) -> dict[str, Any]:
    """Home all axes with the gate closed; needed once after the controller had no power."""
    return await _begin(service, "home", asking)


@router.post("/move", **_ACT)
async def move_machine(request: MoveRequest, service: Service, asking: Asking) -> dict[str, Any]:
    """Move to a place with the gate closed, at the approach speed of the machine file."""
    target_mm = {name.removesuffix("_mm"): place for name, place in request.model_dump(exclude_unset=True).items()}
    return await _begin(service, "move", asking, target_mm)


@router.post("/gate-test", **_ACT)
async def test_gate(service: Service, asking: Asking) -> dict[str, Any]:
    """Close the gate and read it back, and see the guard program run on the controller. The gate is never opened."""
    return await _begin(service, "gate-test", asking)


@router.post("/estop", **_ACT)
async def estop_machine(service: Service, asking: Asking) -> dict[str, Any]:
    """Close the gate, stop all motion at once, switch the motors off, and let nothing move. Open to every key.

    Runs and acts under way are told; where there are none the controller itself is. Only switching the controller's
    power off and on, and homing, end it.
    """
    if not _tell_all(service, "estop", asking):
        service.desk.start("estop", asking)
    return _shown(service)


@everything.post("/abort", status_code=202, responses=refusals())
async def abort_everything(service: Service, asking: Asking) -> Told:
    """Abort whatever runs or moves. Open to every key."""
    return Told(runs=_tell_all(service, "abort", asking))


def _tell_all(service: State, act: str, asking: Holder) -> list[str]:
    """Tell all runs and acts under way; return which heard it."""
    told = service.desk.tell(act, asking)
    for run in service.fleet.living:
        with contextlib.suppress(RunError):  # it has just ended
            service.fleet.act(run, {"act": act, "key": asking.key, "by": asking.name})
            told.append(run)
    return told


async def _begin(
    service: State, act: str, asking: Holder, target_mm: Mapping[str, float] | None = None
) -> dict[str, Any]:
    await service.fleet.settled()
    service.desk.start(act, asking, target_mm)
    return _shown(service)


def _shown(service: State) -> dict[str, Any]:
    return {
        "name": service.machine.name,
        "simulated": service.settings.simulate,
        "running": service.fleet.living,
        "act": service.desk.act,
        "seen": service.desk.seen,
        "links": {"self": "/v1/machine", "events": "/v1/events"},
    }
