from __future__ import annotations

import pytest
from ibfctl_drivers.galil import codec

from ibfctl.errors import ControllerError


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


def test_speed_and_acceleration_fall_on_the_controller_grid() -> None:
    assert codec.acceleration(73422) == 72704
    assert codec.acceleration(3) == 1024
    assert codec.acceleration(1e12) == codec.MAX_ACCELERATION_COUNTS_S2
    assert codec.speed(20001.5) == 20000
    assert codec.speed(1e9) == codec.MAX_SPEED_COUNTS_S
