"""Axis settings that are set as `SPA=1` or `SP 1,2`, asked as `SPA=?` or `SP ?,?`, and read as `_SPA`."""

from __future__ import annotations

from dataclasses import dataclass

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.errors import CommandError

LARGEST_POSITION = 2_147_483_647
FASTEST_COUNTS_S = 22_000_000
LARGEST_ACCELERATION = 1_073_740_800


@dataclass(frozen=True)
class Parameter:
    """Default, range and rounding of one setting.

    Attributes
    ----------
    default : value after power-up
    low, high : smallest and largest value
    step : values are rounded towards zero to a multiple of it
    also : a value outside the range that is accepted all the same
    """

    default: float
    low: float
    high: float
    step: float = 1
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


PARAMETERS: dict[str, Parameter] = {
    # Motion, with effect.
    "SP": Parameter(25000, 0, FASTEST_COUNTS_S, 2),
    "JG": Parameter(25000, -FASTEST_COUNTS_S, FASTEST_COUNTS_S, 2),
    "HV": Parameter(256, 0, FASTEST_COUNTS_S, 2),
    "AC": Parameter(256000, 1024, LARGEST_ACCELERATION, 1024),
    "DC": Parameter(256000, 1024, LARGEST_ACCELERATION, 1024),
    "PA": Parameter(0, -LARGEST_POSITION - 1, LARGEST_POSITION),
    "PR": Parameter(0, -LARGEST_POSITION - 1, LARGEST_POSITION),
    "PT": Parameter(0, 0, 1),
    "ER": Parameter(16384, 1, LARGEST_POSITION, also=-1),
    "OE": Parameter(0, 0, 3),
    "FL": Parameter(LARGEST_POSITION, -LARGEST_POSITION - 1, LARGEST_POSITION),
    "BL": Parameter(-LARGEST_POSITION - 1, -LARGEST_POSITION - 1, LARGEST_POSITION),
    "LD": Parameter(0, 0, 3),
    "TL": Parameter(9.9982, 0, 9.9982, 0.0001),
    # Set-up of drives, encoders and filters: kept and read back, without effect on the motion.
    "MT": Parameter(1, -2.5, 2.5, 0.5),
    "KP": Parameter(6, 0, 1023.875, 0.125),
    "KI": Parameter(0, 0, 255.999, 0.0001),
    "KD": Parameter(64, 0, 4095.875, 0.125),
    "KS": Parameter(1.3125, 0.25, 128, 0.0625),
    "IL": Parameter(9.9982, 0, 9.9982, 0.0001),
    "OF": Parameter(0, -9.9982, 9.9982, 0.0001),
    "FA": Parameter(0, 0, 8191, 0.25),
    "FV": Parameter(0, 0, 8191),
    "LC": Parameter(0, -32767, 32767),
    "AG": Parameter(1, 0, 3),
    "AU": Parameter(0, 0, 23, 0.5),
    "YA": Parameter(2, 1, 9999),
    "YB": Parameter(200, 1, 9999),
    "YC": Parameter(4000, 1, 1_000_000),
    "BR": Parameter(0, -1, 1),
    "CE": Parameter(0, 0, 15),
    "OT": Parameter(30, 2, 32000),
    "OV": Parameter(0.9438, 0, 9.9982, 0.0001),
    "OA": Parameter(0, 0, 1),
    "ZA": Parameter(0, -LARGEST_POSITION - 1, LARGEST_POSITION),
}


class AxisParameters:
    """The present settings of one axis, by command name."""

    def __init__(self) -> None:
        self._values = {name: float(parameter.default) for name, parameter in PARAMETERS.items()}

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def __setitem__(self, name: str, value: float) -> None:
        self._values[name] = value

    def copied(self) -> dict[str, float]:
        """Return all values, to be burned."""
        return dict(self._values)

    def restore(self, values: dict[str, float]) -> None:
        """Take over burned values."""
        self._values.update(values)
