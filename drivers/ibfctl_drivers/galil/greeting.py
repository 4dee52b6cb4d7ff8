"""The first words to a controller: who it is, and that unsolicited text be marked."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from ibfctl.errors import ControllerError
from ibfctl.machine.controller import ControllerIdentity
from ibfctl_drivers.galil import codec
from ibfctl_drivers.galil.axes import AxisReader
from ibfctl_drivers.galil.link import Link, RejectedError
from ibfctl_drivers.galil.segments import PLACES

_log = logging.getLogger(__name__)


def greet(links: Sequence[Link], status: Link) -> None:
    """Have unsolicited text marked on every handle, and clear an error latched by an earlier client."""
    for link in links:
        try:
            link.tell("CW 1")
        except RejectedError as refusal:  # unsolicited text will then break the framing: still safe
            _log.warning("unsolicited text stays unmarked: %s", refusal)
    latched = status.ask("TC1")
    if not latched.startswith("0"):
        _log.info("error latched before this connection: %s", latched)


def identify(status: Link, reader: AxisReader, letters: str) -> ControllerIdentity:
    """Ask who answers, and prove by asking that every axis of the job has a PVT buffer.

    Raises
    ------
    ControllerError
        If it is no such controller, or lacks an axis.
    """
    text = status.ask(codec.IDENTIFY)
    model = codec.parse_identity(text)
    last = ord(letters[-1]) - ord("A") + 1
    if last > model.axes:
        raise ControllerError(
            f"controller {text!r} has {model.axes} axes, the machine file uses axis {letters[-1]}",
            "correct the axis letters in the machine file",
        )
    places = reader.numbers(f"_PV{letter}" for letter in letters)
    if not all(0 <= free <= PLACES for free in places):
        raise ControllerError(f"controller {text!r} has no PVT buffer of {PLACES} places")
    return ControllerIdentity(text, model.axes)
