"""Find the driver that the machine file names; the product itself imports none."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import cast

from ibfctl.errors import InputError
from ibfctl.machine.controller import MotionController, Observer
from ibfctl.machine.description import MachineDescription

GROUP = "ibfctl.drivers"


def connect(machine: MachineDescription, on_exchange: Observer | None = None) -> MotionController:
    """Connect to the machine's controller through the installed driver of the name in the machine file.

    `on_exchange` is told of everything that goes over the wire.

    Raises
    ------
    InputError
        If no such driver is installed.
    LinkError
        If the controller cannot be reached.
    """
    name = machine.connection.driver
    found = entry_points(group=GROUP, name=name)
    if not found:
        installed = ", ".join(sorted(entry_points(group=GROUP).names)) or "none"
        raise InputError(
            f"driver {name!r} of machine {machine.name!r} is not installed", f"installed drivers: {installed}"
        )
    (entry,) = found
    return cast(MotionController, entry.load()(machine, on_exchange))
