"""Acts on a machine that are no runs, each in a process of its own that lives as long as the act.

``python -m ibfctl.service.machine_acts FOLDER`` reads one line of JSON (`Act`) and prints JSON lines as
`ibfctl.service.tasks` does. It holds the machine's lock, takes ``abort`` and ``estop`` through the pipe in FOLDER like
the worker of a run, and aborts when its parent has gone.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from ibfctl.errors import AbortedError, ControllerError, IbfctlError, LimitsError, RunError
from ibfctl.machine.controller import MotionController
from ibfctl.machine.description import MachineDescription, read_machine
from ibfctl.runs.control import URGENT, ControlReader, open_pipe
from ibfctl.runs.drivers import connect
from ibfctl.runs.job import Address
from ibfctl.runs.lock import MachineLock
from ibfctl.runs.preflight import check_clock

Name = Literal["connect", "home", "move", "gate-test", "abort", "estop"]
Figures = dict[str, Any]


class Act(BaseModel):
    """What to do.

    Attributes
    ----------
    name
        Which act.
    machine
        Machine file.
    address, speed
        Of the emulated controller that takes the place of the machine's own, if there is one.
    target_mm
        Where to move, by coordinate.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Name
    machine: Path
    address: Address | None = None
    speed: float = 1.0
    target_mm: dict[str, float] = {}

    def machine_here(self) -> MachineDescription:
        """Return the machine, as its controller is to be reached."""
        machine = read_machine(self.machine)
        if self.address is None:
            return machine
        place = {**self.address.model_dump(), "serial": None}
        return machine.model_copy(update={"connection": machine.connection.model_copy(update=place)})


def look(act: Act, machine: MachineDescription, controller: MotionController) -> Figures:
    """Ask the controller who it is and how all stands."""
    identity = controller.identify()
    homed, told = controller.homed(), controller.status()
    axes = {}
    for letter, axis in machine.axes.items():
        status = told[letter]
        axes[letter] = {
            "coordinate": axis.coordinate,
            "position_mm": status.position_counts / axis.signed_counts_per_mm,
            "position_counts": status.position_counts,
            "error_counts": status.error_counts,
            "stop_code": status.stop_code,
            "moving": status.moving,
            "motor_on": status.motor_on,
            "homed": homed[letter],
        }
    return {
        "model": identity.model,
        "axes": axes,
        "gate": "open" if controller.gate_is_open() else "closed",
        "latched": controller.latched(),
    }


def connect_only(act: Act, machine: MachineDescription, controller: MotionController) -> Figures:
    """Look, and measure the controller's clock."""
    period_s = check_clock(controller, machine.sample_period_s, act.speed)
    return {**look(act, machine, controller), "sample_period_s": period_s}


def home(act: Act, machine: MachineDescription, controller: MotionController) -> Figures:
    """Home all axes with the gate closed."""
    _ready_to_move(act, machine, controller)
    controller.home()
    return look(act, machine, controller)


def move(act: Act, machine: MachineDescription, controller: MotionController) -> Figures:
    """Move axes to positions with the gate closed."""
    counts = {}
    for coordinate, place_mm in act.target_mm.items():
        axis = machine.axis_of(coordinate)
        if not axis.travel_min_mm <= place_mm <= axis.travel_max_mm:
            travel = f"{axis.travel_min_mm:g} to {axis.travel_max_mm:g} mm"
            raise LimitsError(
                f"{coordinate} {place_mm:g} mm is beyond its travel, {travel}",
                "give a place within it",
            )
        counts[machine.letter_of(coordinate)] = round(place_mm * axis.signed_counts_per_mm)
    _ready_to_move(act, machine, controller)
    missing = [letter for letter, is_homed in controller.homed().items() if letter in counts and not is_homed]
    if missing:
        raise RunError(f"axis {', '.join(missing)} does not know where it is", "home the machine first")
    controller.move_to(counts)
    return look(act, machine, controller)


def prove_gate(act: Act, machine: MachineDescription, controller: MotionController) -> Figures:
    """Close the gate and read it back, and see the guard program run; the gate is opened by no test."""
    _alone(act, machine, controller)
    controller.close_gate()
    controller.start_guard(machine.beam_gate.guard_patience_s * act.speed)
    try:
        alive = controller.guard_owner_age_s() is not None
    finally:
        controller.stop_guard()
    if not alive:
        raise ControllerError("the guard on the controller does not run", "see what else runs on it, or power it anew")
    return look(act, machine, controller)


def stop_all(act: Act, machine: MachineDescription, controller: MotionController) -> Figures:
    """Close the gate and stop everything at once."""
    controller.abort()
    return look(act, machine, controller)


def stop_in_emergency(act: Act, machine: MachineDescription, controller: MotionController) -> Figures:
    """Close the gate, stop everything, switch the motors off, latch that."""
    controller.estop()
    return look(act, machine, controller)


ACTS: Mapping[str, Callable[[Act, MachineDescription, MotionController], Figures]] = {
    "connect": connect_only,
    "home": home,
    "move": move,
    "gate-test": prove_gate,
    "abort": stop_all,
    "estop": stop_in_emergency,
}


def main() -> int:
    """Do one act; return the exit code."""
    folder = Path(sys.argv[1])
    act = Act.model_validate_json(sys.stdin.readline())
    try:
        with ExitStack() as resources:
            machine = act.machine_here()
            if act.name not in URGENT:  # an emergency waits for nobody
                resources.enter_context(MachineLock(machine, f"machine act {act.name}"))
            controller = connect(machine)
            resources.callback(controller.close)
            interruption = _Interruption(controller)
            reader = ControlReader(open_pipe(folder), interruption, lambda what: None)
            resources.callback(reader.close)
            try:
                figures = ACTS[act.name](act, machine, controller)
            except ControllerError as error:
                raise interruption.error or error from error
            if interruption.error is not None:
                raise interruption.error
    except IbfctlError as error:
        _print("failed", code=error.code, message=error.message, hint=error.hint)
        return error.exit_code
    _print("finished", figures=figures)
    return 0


class _Interruption:
    """Ends an act from outside, over a handle of its own."""

    def __init__(self, controller: MotionController) -> None:
        self._controller = controller
        self.error: IbfctlError | None = None
        threading.Thread(target=self._await_parent, name="parent", daemon=True).start()

    def __call__(self, told: Mapping[str, Any]) -> None:
        """Take what comes through the pipe; everything but an e-stop aborts."""
        self.error = AbortedError(
            f"machine act was ended by {told['act']}", "look at the machine before it moves again"
        )
        try:
            (self._controller.estop if told["act"] == "estop" else self._controller.abort)()
        except ControllerError as error:
            self.error = error

    def _await_parent(self) -> None:
        while os.read(0, 4096):
            pass
        self({"act": "the end of the service"})


def _ready_to_move(act: Act, machine: MachineDescription, controller: MotionController) -> None:
    """Close the gate and switch the servos on, unless nothing may move."""
    if controller.latched():
        raise RunError("an emergency stop is latched on the controller", "switch its power off and on, then home")
    _alone(act, machine, controller)
    controller.close_gate()
    controller.servo_on()


def _alone(act: Act, machine: MachineDescription, controller: MotionController) -> None:
    """Refuse to touch a controller whose guard hears from another host."""
    age_s = controller.guard_owner_age_s()
    if age_s is not None and age_s < machine.beam_gate.guard_patience_s * act.speed:
        raise RunError("somebody else runs this controller", "see which other host is connected to it")


def _print(event: str, **fields: Any) -> None:
    print(json.dumps({"event": event, **fields}), flush=True)


if __name__ == "__main__":
    sys.exit(main())
