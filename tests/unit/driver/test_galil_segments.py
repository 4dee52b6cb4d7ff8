from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ibfctl_drivers.galil.segments import mode_for
from support.programs import contour, program

from ibfctl.errors import ControllerError, LimitsError
from ibfctl.machine.program import MotionProgram, PvtProgram


def test_the_axes_of_a_segment_stand_side_by_side() -> None:
    small = program(40)
    first, second, third = lines_of(small, 3, 5)[:3]
    axis = small.axes["A"]
    assert first == b"PVA=%d,%d,60\r" % (axis.increment_counts[3], axis.end_velocity_counts_s[3])
    assert second.startswith(b"PVB=")
    assert third.startswith(b"PVA=")


def lines_of(job: MotionProgram, first: int, last: int) -> list[bytes]:
    return mode_for(job).lines(job, first, last)


def changed(what: str, value: int) -> PvtProgram:
    whole = program(40)
    if what == "time":
        return replace(whole, time_samples=np.where(np.arange(40) == 7, value, whole.time_samples))
    field = {"move": "increment_counts", "velocity": "end_velocity_counts_s"}[what]
    column = getattr(whole.axes["B"], field).copy()
    column[7] = value
    return replace(whole, axes={**whole.axes, "B": replace(whole.axes["B"], **{field: column})})


@pytest.mark.parametrize(
    ("what", "allowed", "refused"),
    [
        ("time", [2, 2048], [0, 1, 3, 2050, -2]),
        ("move", [44_000_000, -44_000_000], [44_000_001, -44_000_001]),
        ("velocity", [22_000_000, -22_000_000], [22_000_001, -22_000_001]),
    ],
)
def test_ranges_are_checked_before_the_wire(what: str, allowed: list[int], refused: list[int]) -> None:
    for value in allowed:
        lines = lines_of(changed(what, value), 0, 40)
        assert max(map(len, lines)) <= 80
    for value in refused:
        with pytest.raises(LimitsError, match="segment 7"):
            lines_of(changed(what, value), 5, 40)
    assert lines_of(changed(what, refused[0]), 8, 40)


def test_a_contour_segment_is_one_line_for_all_axes() -> None:
    job = contour(40)
    (line,) = mode_for(job).lines(job, 3, 4)
    moves = [job.axes[letter].increment_counts[3] for letter in "AB"]
    assert line == b"CD %d,%d=%d\r" % (*moves, job.time_exponents[3])
    assert mode_for(job).end_lines() == [b"CD 0,0=0\r"]


def test_the_fields_of_a_contour_line_stand_for_letters() -> None:
    job = contour(3)
    lettered = replace(job, axes={"B": job.axes["A"], "D": job.axes["B"]}, coordinates={"x": "B", "y": "D"})
    assert mode_for(lettered).end_lines() == [b"CD ,0,,0=0\r"]


@pytest.mark.parametrize("exponent", [-1, 0, 9])
def test_a_contour_knows_eight_times_only(exponent: int) -> None:
    job = contour(10)
    times = job.time_exponents.copy()
    times[7] = exponent
    with pytest.raises(LimitsError, match="segment 7: time exponent"):
        lines_of(replace(job, time_exponents=times), 5, 10)


@pytest.mark.parametrize("places_per_record", [1, 2])
def test_a_contour_buffer_may_count_records_or_axes(places_per_record: int) -> None:
    mode = mode_for(contour(400))
    assert mode.counts([511], 0) == ([0, 0], [255, 255])
    assert mode.counts([511 - 64 * places_per_record], 64) == ([0, 0], [191, 191])
    assert mode.counts([511 - 200 * places_per_record], 255) == ([55, 55], [55, 55])
    assert mode.counts([511], 401) == ([401, 401], [255, 255])


def test_a_contour_buffer_that_counts_otherwise_is_refused() -> None:
    with pytest.raises(ControllerError, match="64 contour records take 96 places"):
        mode_for(contour(400)).counts([511 - 96], 64)
