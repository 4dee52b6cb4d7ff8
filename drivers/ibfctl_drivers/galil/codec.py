"""Galil's words: the text of commands, and what may be believed of a reply.

Every range is checked here, before anything reaches the wire.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from ibfctl.errors import ControllerError

MAX_SPEED_COUNTS_S = 22_000_000
MAX_ACCELERATION_COUNTS_S2 = 1_073_740_800
ACCELERATION_STEP_COUNTS_S2 = 1024
IDENTIFY = "\x12\x16"

_NUMBER = re.compile(r"-?[0-9]{1,10}(\.[0-9]+)?")
_MODEL = re.compile(r"DMC(?P<model>\d{4,5})\S*\s+Rev\s+(?P<firmware>\d+\.\d+\w*)")
_FIRMWARE = re.compile(r"(\d+)\.(\d+)([a-z]*)")
_FIRST_FIRMWARE_WITH_PVT = {"40": (1, 2, "i"), "41": (1, 2, "f")}


@dataclass(frozen=True)
class Model:
    """What the identity text says: model number, firmware revision and number of axes."""

    number: str
    firmware: str
    axes: int


def parse_identity(text: str) -> Model:
    """Read the text that ``^R^V`` answers, such as ``DMC4020 Rev 1.3a``.

    Raises
    ------
    ControllerError
        If the text names no Galil controller, or one whose firmware has no PVT mode.
    """
    match = _MODEL.match(text)
    if match is None:
        raise ControllerError(f"{text!r} is no Galil controller", "check host and port in the machine file")
    if "-FAST" in text.upper():
        raise ControllerError(f"controller {text!r}: -FAST has no PVT mode", "load standard firmware")
    number, firmware = match["model"], match["firmware"]
    needed = _FIRST_FIRMWARE_WITH_PVT.get(number[:2])
    if number[:2] == "21" or (needed is not None and _revision(firmware) < needed):
        raise ControllerError(f"controller {text!r} has no PVT mode", "update its firmware")
    return Model(number, firmware, int(number[-2]))


def _revision(firmware: str) -> tuple[int, int, str]:
    match = _FIRMWARE.match(firmware.lower())
    assert match is not None  # _MODEL has seen the same digits
    return int(match[1]), int(match[2]), match[3]


def parse_numbers(text: str, count: int, what: str) -> list[float]:
    """Read exactly `count` numbers, separated by blanks or commas, as `MG` and `TP` answer them.

    Raises
    ------
    ControllerError
        If there are more or fewer, or one of them is no number.
    """
    fields = re.split(r"\s*,\s*|\s+", text.strip())
    if len(fields) != count or not all(map(_NUMBER.fullmatch, fields)):
        raise ControllerError(
            f"controller answered {text[:60]!r} to {what!r} where {count} numbers belong",
            "check that no other program uses this handle, then connect again",
        )
    return [float(field) for field in fields]


def parse_integers(text: str, count: int, what: str) -> list[int]:
    """Read exactly `count` whole numbers; raises `ControllerError` as `parse_numbers`."""
    numbers = parse_numbers(text, count, what)
    if not all(number.is_integer() for number in numbers):
        raise ControllerError(f"controller answered {text[:60]!r} to {what!r} where whole numbers belong")
    return [int(number) for number in numbers]


def message_of(operands: Iterable[str]) -> str:
    """Return the command that asks for the values of `operands` in one round trip."""
    return "MG " + ",".join(operands)


def acceleration(counts_s2: float) -> int:
    """Return the nearest acceleration that the controller can represent and that is not greater."""
    whole = int(counts_s2) // ACCELERATION_STEP_COUNTS_S2 * ACCELERATION_STEP_COUNTS_S2
    return min(max(whole, ACCELERATION_STEP_COUNTS_S2), MAX_ACCELERATION_COUNTS_S2)


def speed(counts_s: float) -> int:
    """Return the nearest even speed that is not greater and that the controller can represent."""
    return min(max(int(counts_s) // 2 * 2, 2), MAX_SPEED_COUNTS_S)
