"""`ibfctl machine`: the machine of the service between runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from ibfctl.cli.output import print_json, print_lines, print_table
from ibfctl.cli.remote import failed, with_client

if TYPE_CHECKING:
    from ibfctl.client import Client
    from ibfctl.client.records import MachineNow

_COLUMNS = ("axis", "coordinate", "position_mm", "position_counts", "error_counts", "stop_code", "motor_on", "homed")


@click.group(name="machine")
def command() -> None:
    """The machine of the service between runs; the beam gate is closed in all of it."""


@command.command()
@with_client
def status(client: Client, as_json: bool) -> None:
    """Show what is known of the machine; asks the controller nothing."""
    _show(client.machine.show(), as_json)


@command.command()
@with_client
def connect(client: Client, as_json: bool) -> None:
    """Ask the controller who it is and how all stands, and measure its clock."""
    _end(client.machine.connect(), as_json)


@command.command()
@with_client
def home(client: Client, as_json: bool) -> None:
    """Home all axes; needed once after the controller had no power."""
    _end(client.machine.home(), as_json)


@command.command()
@click.option("--x-mm", type=float, help="Coordinate of the machine, mm; without it x stays.")
@click.option("--y-mm", type=float, help="Coordinate of the machine, mm; without it y stays.")
@with_client
def move(client: Client, x_mm: float | None, y_mm: float | None, as_json: bool) -> None:
    """Move to a place at the approach speed of the machine file."""
    if x_mm is None and y_mm is None:
        raise click.UsageError("Give --x-mm, --y-mm or both.")
    _end(client.machine.move(x_mm, y_mm), as_json)


@command.command(name="gate-test")
@with_client
def gate_test(client: Client, as_json: bool) -> None:
    """Close the gate, read it back, and see the guard program run on the controller."""
    _end(client.machine.gate_test(), as_json)


@command.command()
@with_client
def estop(client: Client, as_json: bool) -> None:
    """Stop everything, switch the motors off, and let nothing move until the controller's power was off."""
    _end(client.machine.estop(), as_json)


def _end(now: MachineNow, as_json: bool) -> None:
    if "act" in now and "error" in now["act"]:
        raise failed(now["act"]["error"])
    _show(now, as_json)


def _show(now: MachineNow, as_json: bool) -> None:
    if as_json:
        print_json(now)
        return
    lines = [("machine", now["name"] + (" (emulated)" if now["simulated"] else ""))]
    lines.append(("under way", ", ".join(now["running"]) or "nothing"))
    if "act" in now:
        lines.append(("last act", f"{now['act']['name']}: {now['act']['state']}"))
    seen = now.get("seen")
    if seen is None:
        print_lines([*lines, ("seen", "not yet: `ibfctl machine connect` asks the controller")])
        return
    lines += [("seen", seen["at"]), ("controller", seen["model"]), ("gate", seen["gate"])]
    if seen["latched"]:
        lines.append(("emergency stop", "latched: nothing moves until the controller's power was off"))
    print_lines(lines)
    print_table([{"axis": letter, **axis} for letter, axis in seen["axes"].items()], _COLUMNS)
