"""What an axis finds on its way: limit switches, the home switch and the encoder's index pulse.

All places are physical counts: they do not move when the host redefines the position with `DP`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ibfctl_simulator.galil.profiles import FloatArray

Direction = Literal["forward", "reverse"]


@dataclass(frozen=True)
class SwitchPlaces:
    """Where the switches of one axis are, in physical counts; None for a switch that is never active.

    Attributes
    ----------
    forward, reverse
        Beyond these places the limit switches are active.
    home
        From this place on the home switch is active.
    index_period
        Distance between two index pulses; they lie at its multiples.
    """

    forward: int | None = None
    reverse: int | None = None
    home: int | None = 0
    index_period: int = 4000


class Switches:
    """The switches of one axis, and those that a fault holds active."""

    def __init__(self, places: SwitchPlaces) -> None:
        self.places = places
        self.forced: set[Direction] = set()

    def present(self, direction: Direction) -> bool:
        """Whether the limit switch of a direction can be active at all."""
        place = self.places.forward if direction == "forward" else self.places.reverse
        return place is not None or direction in self.forced

    def active(self, direction: Direction, physical_counts: FloatArray) -> NDArray[np.bool_]:
        """Whether the limit switch of a direction is active at each of some places."""
        if direction in self.forced:
            return np.ones(len(physical_counts), dtype=np.bool_)
        place = self.places.forward if direction == "forward" else self.places.reverse
        if place is None:
            return np.zeros(len(physical_counts), dtype=np.bool_)
        return physical_counts > place if direction == "forward" else physical_counts < place

    def active_at(self, direction: Direction, physical_counts: float) -> bool:
        """Whether the limit switch of a direction is active at one place."""
        return bool(self.active(direction, np.array([physical_counts]))[0])

    def home(self, physical_counts: FloatArray) -> NDArray[np.bool_]:
        """Whether the home switch is active at each of some places."""
        if self.places.home is None:
            return np.zeros(len(physical_counts), dtype=np.bool_)
        return physical_counts >= self.places.home

    def home_at(self, physical_counts: float) -> bool:
        """Whether the home switch is active at one place."""
        return bool(self.home(np.array([physical_counts]))[0])

    def index_passed(self, from_counts: float, physical_counts: FloatArray) -> NDArray[np.bool_]:
        """Whether an index pulse was reached or passed on the way to each of some places."""
        period = self.places.index_period
        track = np.concatenate(([from_counts], physical_counts))
        turns = np.floor(track / period)
        passed: NDArray[np.bool_] = (turns[1:] != turns[:-1]) | (physical_counts % period == 0)
        return passed


def first_true(flags: NDArray[np.bool_]) -> int | None:
    """Index of the first true flag, None if there is none."""
    found = np.flatnonzero(flags)
    return int(found[0]) if len(found) else None
