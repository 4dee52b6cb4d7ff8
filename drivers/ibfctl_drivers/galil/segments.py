"""The two kinds of segments that the controller streams: PVT cubics and contour lines."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import ControllerError, LimitsError
from ibfctl.machine.program import (
    MAX_CONTOUR_COUNTS,
    MAX_CONTOUR_EXPONENT,
    MAX_INCREMENT_COUNTS,
    MAX_SEGMENT_SAMPLES,
    MAX_VELOCITY_COUNTS_S,
    ContourProgram,
    IntArray,
    MotionProgram,
    PvtProgram,
)

PLACES = 255
CONTOUR_PLACES = 511


class SegmentMode(Protocol):
    """What differs between the kinds."""

    def enter(self) -> list[str]:
        """Return the commands that make the axes ready, with empty buffers."""

    shutter: bool
    """Whether the controller counts segments, so that it can open and close the gate at one of them."""

    def lines(self, program: MotionProgram, first: int, last: int) -> list[bytes]:
        """Return complete lines for segments `first` to `last` (exclusive), checked against all ranges.

        Raises
        ------
        LimitsError
            If a number is beyond the controller's range; it names axis, segment and number.
        """

    def place_of(self, line: int, first: int) -> str:
        """Say which segment a line of the batch that begins with segment `first` belongs to."""

    def end_lines(self) -> list[bytes]:
        """Return the lines of the end marker."""

    def begin(self) -> str:
        """Return the command that starts all axes on the same sample."""

    def operands(self) -> list[str]:
        """Return what to ask for: executed and free, for each axis."""

    def counts(self, values: list[int], queued: int) -> tuple[list[int], list[int]]:
        """Return executed segments and free places of each axis from the operands' values."""


def mode_for(program: MotionProgram) -> SegmentMode:
    """Return the mode that streams `program`."""
    return ContourMode(program) if isinstance(program, ContourProgram) else PvtMode(program)


MOST_LOW_WATER = 16


def low_water(program: MotionProgram, samples: int, sent: int) -> int:
    """How many waiting segments last for `samples`, when the last one sent is the one before `sent`; at most 16."""
    times = program.time_samples[max(sent - MOST_LOW_WATER, 0) : sent][::-1]
    enough = np.flatnonzero(np.cumsum(times) >= samples)
    return int(enough[0]) + 1 if enough.size else MOST_LOW_WATER


class PvtMode:
    """`PV` and `BT`: a queue of 255 places for every axis, each with its own counts."""

    shutter = True

    def __init__(self, program: PvtProgram) -> None:
        self._letters = sorted(program.axes)

    def enter(self) -> list[str]:
        """Empty the queues."""
        return [f"PV{letter}=0,0,-1" for letter in self._letters]

    def lines(self, program: MotionProgram, first: int, last: int) -> list[bytes]:
        """Return one line per axis and segment, the axes of a segment side by side."""
        assert isinstance(program, PvtProgram)
        times = program.time_samples[first:last]
        odd = (times < 2) | (times > MAX_SEGMENT_SAMPLES) | (times % 2 != 0)
        _refuse_where(odd, times, first, "time", "samples", f"even, 2 to {MAX_SEGMENT_SAMPLES}")
        columns = []
        for letter in self._letters:
            axis = program.axes[letter]
            moves, speeds = axis.increment_counts[first:last], axis.end_velocity_counts_s[first:last]
            _refuse_beyond(moves, MAX_INCREMENT_COUNTS, first, f"axis {letter} move", "counts")
            _refuse_beyond(speeds, MAX_VELOCITY_COUNTS_S, first, f"axis {letter} velocity", "counts/s")
            rows = zip(moves.tolist(), speeds.tolist(), times.tolist(), strict=True)
            columns.append([b"PV%c=%d,%d,%d\r" % (ord(letter), *row) for row in rows])
        return [line for row in zip(*columns, strict=True) for line in row]

    def place_of(self, line: int, first: int) -> str:
        """Lines alternate between the axes."""
        segment, axis = divmod(line, len(self._letters))
        return f"segment {first + segment} of axis {self._letters[axis]}"

    def end_lines(self) -> list[bytes]:
        """One marker per axis."""
        return [b"PV%c=0,0,0\r" % ord(letter) for letter in self._letters]

    def begin(self) -> str:
        """Begin all axes on one sample."""
        return f"BT {''.join(self._letters)}"

    def operands(self) -> list[str]:
        """The counts of all axes come first, next to each other, so that they are of nearly one moment."""
        return [f"{operand}{letter}" for operand in ("_BT", "_PV") for letter in self._letters]

    def counts(self, values: list[int], queued: int) -> tuple[list[int], list[int]]:
        """Take both as the controller tells them."""
        return values[: len(self._letters)], values[len(self._letters) :]


class ContourMode:
    """`CM` and `CD`: one queue for all axes, which tells how many places are free and nothing else.

    Whether a record takes one place or one for each axis is learned from the first records that wait. No
    more than 255 of them ever do, so that either fits.
    """

    shutter = False

    def __init__(self, program: ContourProgram) -> None:
        self._letters = sorted(program.axes)
        self._places_per_record = 0

    def enter(self) -> list[str]:
        """Pause, so that records can wait, and enter the mode."""
        return ["DT -1", f"CM {''.join(self._letters)}"]

    def lines(self, program: MotionProgram, first: int, last: int) -> list[bytes]:
        """Return one line per segment."""
        assert isinstance(program, ContourProgram)
        exponents = program.time_exponents[first:last]
        odd = (exponents < 1) | (exponents > MAX_CONTOUR_EXPONENT)
        _refuse_where(odd, exponents, first, "time exponent", "", f"1 to {MAX_CONTOUR_EXPONENT}")
        columns = []
        for letter in self._letters:
            moves = program.axes[letter].increment_counts[first:last]
            _refuse_beyond(moves, MAX_CONTOUR_COUNTS, first, f"axis {letter} move", "counts")
            columns.append(moves.tolist())
        rows = zip(*columns, exponents.tolist(), strict=True)
        return [b"CD %s=%d\r" % (self._fields(row[:-1]), row[-1]) for row in rows]

    def place_of(self, line: int, first: int) -> str:
        """One line is one segment."""
        return f"segment {first + line}"

    def end_lines(self) -> list[bytes]:
        """One marker for all axes; without the blank it would assign a variable."""
        return [b"CD %s=0\r" % self._fields([0] * len(self._letters))]

    def begin(self) -> str:
        """End the pause; the number itself holds for records without a time, and there are none."""
        return "DT 1"

    def operands(self) -> list[str]:
        """Ask for the free places."""
        return ["_CM"]

    def counts(self, values: list[int], queued: int) -> tuple[list[int], list[int]]:
        """Count what no longer waits as executed: the record in motion is one of them."""
        taken = CONTOUR_PLACES - values[0]
        if not self._places_per_record and queued:
            self._places_per_record, odd = divmod(taken, queued)
            if odd or not self._places_per_record:
                raise ControllerError(f"{queued} contour records take {taken} places")
        waiting = taken // (self._places_per_record or 1)
        axes = len(self._letters)
        return [queued - waiting] * axes, [PLACES - waiting] * axes

    def _fields(self, moves: list[int] | tuple[int, ...]) -> bytes:
        """Fields stand for the axes from A on."""
        by_letter = dict(zip(self._letters, moves, strict=True))
        letters = map(chr, range(ord("A"), ord(self._letters[-1]) + 1))
        return ",".join(str(by_letter.get(letter, "")) for letter in letters).encode("ascii")


def _refuse_beyond(values: IntArray, largest: int, first: int, what: str, unit: str) -> None:
    _refuse_where(np.abs(values) > largest, values, first, what, unit, f"up to {largest}")


def _refuse_where(
    bad: NDArray[np.bool_], values: IntArray, first: int, what: str, unit: str, allowed: str
) -> None:
    if bad.any():
        place = int(np.argmax(bad))
        raise LimitsError(
            f"segment {first + place}: {what} of {int(values[place])} {unit} is outside the range",
            f"allowed: {allowed}; plan the job again",
        )
