from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ibfctl_drivers.galil import codec
from support.programs import program

from ibfctl.errors import ControllerError, LimitsError
from ibfctl.machine.program import PvtProgram


@pytest.mark.parametrize(
    ("text", "number", "firmware", "axes"),
    [
        ("DMC4020 Rev 1.3a", "4020", "1.3a", 2),
        ("DMC4080 Rev 1.2i1-SIN", "4080", "1.2i1", 8),
        ("DMC4143 Rev 1.2F", "4143", "1.2F", 4),
        ("DMC50040 Rev 1.2a", "50040", "1.2a", 4),
        ("DMC1846 Rev 1.1g", "1846", "1.1g", 4),
    ],
)
def test_identity_names_model_firmware_and_axes(text: str, number: str, firmware: str, axes: int) -> None:
    assert codec.parse_identity(text) == codec.Model(number, firmware, axes)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("DMC4040 Rev 1.3a-FAST", "-FAST"),
        ("DMC4040 Rev 1.2h1-SIN", "no PVT mode"),
        ("DMC4143 Rev 1.2e", "no PVT mode"),
        ("DMC2143 Rev 1.0s", "no PVT mode"),
        ("SSH-2.0-OpenSSH_9.2", "no Galil controller"),
        ("", "no Galil controller"),
    ],
)
def test_a_controller_without_pvt_is_refused_by_name(text: str, why: str) -> None:
    with pytest.raises(ControllerError, match=why):
        codec.parse_identity(text)


@pytest.mark.parametrize("text", ["1.0000 -2.0000", "1, -2", " 1.0000   -2.0000 ", "1,-2"])
def test_numbers_come_apart_at_blanks_and_commas(text: str) -> None:
    assert codec.parse_integers(text, 2, "TP") == [1, -2]


@pytest.mark.parametrize(
    "text", ["", "1", "1 2 3", "1 x", "1 2.5", "1 nan", "1 1e3", "1 0x2", "1 --2", "1 ٢"]
)
def test_what_is_not_the_right_count_of_numbers_is_refused(text: str) -> None:
    with pytest.raises(ControllerError, match="numbers belong"):
        codec.parse_integers(text, 2, "TP")


def test_the_axes_of_a_segment_stand_side_by_side() -> None:
    small = program(40)
    first, second, third = codec.segment_lines(small, 3, 5)[:3]
    axis = small.axes["A"]
    assert first == b"PVA=%d,%d,60\r" % (axis.increment_counts[3], axis.end_velocity_counts_s[3])
    assert second.startswith(b"PVB=")
    assert third.startswith(b"PVA=")


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
        lines = codec.segment_lines(changed(what, value), 0, 40)
        assert max(map(len, lines)) <= 80
    for value in refused:
        with pytest.raises(LimitsError, match="segment 7"):
            codec.segment_lines(changed(what, value), 5, 40)
    assert codec.segment_lines(changed(what, refused[0]), 8, 40)


def test_speed_and_acceleration_fall_on_the_controller_grid() -> None:
    assert codec.acceleration(73422) == 72704
    assert codec.acceleration(3) == 1024
    assert codec.acceleration(1e12) == codec.MAX_ACCELERATION_COUNTS_S2
    assert codec.speed(20001.5) == 20000
    assert codec.speed(1e9) == codec.MAX_SPEED_COUNTS_S
