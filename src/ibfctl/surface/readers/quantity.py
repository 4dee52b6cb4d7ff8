"""What a file tabulates: heights or removal rates, and how their units are written."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from ibfctl.errors import InputError
from ibfctl.units import HEIGHT_IN_NM, LENGTH_IN_MM, RATE_IN_NM_S

MAX_PIXELS = 8192 * 8192
MAX_PITCH_MISMATCH = 1e-3
_NAME = re.compile(r"([A-Za-z]+)(?:[\s_]*[\[(]?\s*([^\s\[\]()]+)\s*[\])]?)?")


@dataclass(frozen=True)
class Quantity:
    """A tabulated quantity.

    Attributes
    ----------
    what
        How messages call a file of it.
    stem, example
        Its name in files, and with a unit appended.
    units
        Factor from each unit that files may name to nm or nm/s.
    largest
        Largest plausible span in nm or nm/s; beyond it, units have been mixed up.
    unit_option, pixel_option
        Options of the command line that give what a file does not say.
    """

    what: str
    stem: str
    example: str
    units: Mapping[str, float]
    largest: float
    unit_option: str
    pixel_option: str

    def split(self, name: str) -> tuple[str, str | None]:
        """Split `height_nm`, `x [mm]` or `Z` into a lower-case stem and the unit (None without one)."""
        match = _NAME.fullmatch(name.strip())
        if match is None:
            return name.strip().lower(), None
        stem, unit = match[1].lower(), match[2]
        if unit is not None and stem not in ("x", "y"):
            unit = unit.replace("_", "/")
        return stem, unit

    def scale(self, declared: str | None, given: str | None, where: str) -> float:
        """Return the factor to nm or nm/s; `declared` is the file's unit, `given` the command line's."""
        if declared is not None and given is not None and declared != given:
            raise InputError(
                f"{where}: the file says {declared} but {self.unit_option} says {given}", "give only one unit"
            )
        unit = declared if declared is not None else given
        if unit is None:
            raise InputError(
                f"{where}: does not say in which unit its values are",
                f"give it with {self.unit_option} ({', '.join(self.units)})",
            )
        if unit not in self.units:
            raise InputError(f"{where}: unknown unit {unit!r} of {self.stem}", f"use one of {', '.join(self.units)}")
        return self.units[unit]

    def refuse_heights(self, where: str) -> None:
        """Refuse a file of a measuring instrument, which holds heights, where rates are wanted."""
        if self.stem != "height":
            raise InputError(
                f"{where}: a measuring instrument's file holds heights, no rates",
                "make the influence function from the maps before and after a dwell: ibfctl tif",
            )

    def pixel_mm(self, declared_mm: float | None, given_mm: float | None, where: str) -> float:
        """Return the pixel size on which the file and the command line agree."""
        for value_mm in (declared_mm, given_mm):
            if value_mm is not None and not 0 < value_mm < float("inf"):
                raise InputError(
                    f"{where}: pixel size is {value_mm:g} mm, it must be positive", "give the true pixel size"
                )
        if declared_mm is None and given_mm is None:
            raise InputError(f"{where}: does not say its pixel size", f"give it with {self.pixel_option}")
        if declared_mm is None or given_mm is None:
            return declared_mm if declared_mm is not None else given_mm  # type: ignore[return-value]
        if abs(declared_mm - given_mm) > MAX_PITCH_MISMATCH * given_mm:
            raise InputError(
                f"{where}: a pixel is {declared_mm:.6g} mm, but {self.pixel_option} says {given_mm:.6g} mm",
                "leave the option out, or correct the file",
            )
        return declared_mm


def length_scale(unit: str, where: str) -> float:
    """Return the factor from `unit` to mm."""
    if unit not in LENGTH_IN_MM:
        raise InputError(f"{where}: unknown unit {unit!r} of length", f"use one of {', '.join(LENGTH_IN_MM)}")
    return LENGTH_IN_MM[unit]


HEIGHT = Quantity("map", "height", "height_nm", HEIGHT_IN_NM, 1e6, "--map-unit", "--map-pixel-mm")
RATE = Quantity("influence function", "rate", "rate_nm_s", RATE_IN_NM_S, 1e6, "--tif-unit", "--tif-pixel-mm")
