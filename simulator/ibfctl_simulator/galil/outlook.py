"""What lies ahead of an axis: its coming samples, up to the first at which something happens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ibfctl_simulator.galil.parameters import LARGEST_POSITION
from ibfctl_simulator.galil.profiles import FloatArray
from ibfctl_simulator.galil.switches import Direction, first_true

if TYPE_CHECKING:
    from ibfctl_simulator.galil.axis import Axis

LOOK_AHEAD_SAMPLES = 512
"""How far an axis looks ahead at least: many short chunks then cost little more than one long one."""


@dataclass(frozen=True)
class Motion:
    """What one axis did during some samples.

    Attributes
    ----------
    commanded_counts, encoder_counts : (n,) float64
    """

    commanded_counts: FloatArray
    encoder_counts: FloatArray


@dataclass
class Outlook:
    """Coming samples, how many of them have passed, and what happens at the last of them.

    Attributes
    ----------
    commanded, load, encoder : (n,) float64, counts
    reaction
        What is done at the last sample, None for nothing.
    """

    commanded: FloatArray
    load: FloatArray
    encoder: FloatArray
    reaction: Callable[[], None] | None
    passed: int = 0

    @property
    def left(self) -> int:
        """How many samples are still to pass."""
        return len(self.commanded) - self.passed


def look_ahead(axis: Axis, commanded: FloatArray, first_sample: int) -> Outlook:
    """Follow coming commanded positions, from absolute sample `first_sample` on, up to the first event."""
    load = commanded
    if axis.motor_on:
        load = axis.servo.look(commanded, axis.commanded_counts, axis.sample_period_s)
    encoder = axis.servo.read(load, first_sample)
    count, reaction = len(commanded), None
    for found, react in (
        (_limit(axis, "forward", commanded, load), lambda: axis.meet_limit("forward")),
        (_limit(axis, "reverse", commanded, load), lambda: axis.meet_limit("reverse")),
        (_error_change(axis, commanded, encoder), axis.meet_error),
        (_sought(axis, load), axis.on_found),
        (_settled(axis), None),
    ):
        if found is not None and found < count:
            count, reaction = found + 1, react
    return Outlook(commanded[:count], load[:count], encoder[:count], reaction)


def _limit(axis: Axis, direction: Direction, commanded: FloatArray, load: FloatArray) -> int | None:
    """Index of the first sample that moves into a limit."""
    if axis.profile is None or axis.stopping_at_limit:
        return None
    forward = direction == "forward"
    place = axis.parameters["FL" if forward else "BL"]
    met = np.zeros(len(commanded), dtype=np.bool_)
    if abs(place) < LARGEST_POSITION:
        met |= commanded > place if forward else commanded < place
    if axis.limit_enabled(direction) and axis.switches.present(direction):
        met |= axis.switches.active(direction, load + axis.origin_counts)
    if not met.any():
        return None
    steps = np.diff(commanded, prepend=axis.commanded_counts)
    return first_true(met & (steps > 0 if forward else steps < 0))


def _error_change(axis: Axis, commanded: FloatArray, encoder: FloatArray) -> int | None:
    """Index of the first sample at which the following error becomes too large, or small again."""
    if not axis.motor_on or axis.parameters["ER"] < 0 or (axis.servo.faithful and not axis.error_seen):
        return None
    large = np.abs(np.rint(commanded) - encoder) > axis.parameters["ER"]
    return first_true(large != axis.error_seen)


def _sought(axis: Axis, load: FloatArray) -> int | None:
    """Index of the first sample at which homing finds what it looks for."""
    return None if axis.search is None else axis.search(load + axis.origin_counts, axis.physical_counts)


def _settled(axis: Axis) -> int | None:
    """Index of the first sample at which a load that lags behind an ended profile stands still."""
    if axis.profile is not None or axis.servo.ideal:
        return None
    return axis.servo.first_settled(axis.commanded_counts)
