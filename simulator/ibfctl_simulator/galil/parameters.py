"""Axis settings that are set as `SPA=1` or `SP 1,2`, asked as `SPA=?` or `SP ?,?`, and read as `_SPA`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.errors import CommandError

LARGEST_POSITION = 2_147_483_647
FASTEST_COUNTS_S = 22_000_000
LARGEST_ACCELERATION = 1_073_740_800


@dataclass(frozen=True)
class Parameter:
    """Range and rounding of one setting.

    Attributes
    ----------
    low, high : smallest and largest value
    step : values are rounded towards zero to a multiple of it
    also : a value outside the range that is accepted all the same
    """

    low: float
    high: float
    step: int = 1
    also: float | None = None

    def rounded(self, value: float) -> float:
        """Return the value that the controller keeps.

        Raises
        ------
        CommandError
            6 if it is out of range.
        """
        if value != self.also and not self.low <= value <= self.high:
            raise CommandError(errors.OUT_OF_RANGE)
        return float(int(value / self.step) * self.step)


def speed_step(time_setting: float) -> int:
    """Resolution of a speed in counts/s: 2 at TM 1000."""
    return max(1, round(2000.0 / time_setting))


PARAMETERS: dict[str, Callable[[float], Parameter]] = {
    "SP": lambda time_setting: Parameter(0, FASTEST_COUNTS_S, speed_step(time_setting)),
    "JG": lambda time_setting: Parameter(-FASTEST_COUNTS_S, FASTEST_COUNTS_S, speed_step(time_setting)),
    "AC": lambda _: Parameter(1024, LARGEST_ACCELERATION, 1024),
    "DC": lambda _: Parameter(1024, LARGEST_ACCELERATION, 1024),
    "PA": lambda _: Parameter(-LARGEST_POSITION - 1, LARGEST_POSITION),
    "PR": lambda _: Parameter(-LARGEST_POSITION - 1, LARGEST_POSITION),
    "ER": lambda _: Parameter(1, LARGEST_POSITION, also=-1),
    "OE": lambda _: Parameter(0, 3),
}
"""Range of each setting, given the value of `TM`."""
