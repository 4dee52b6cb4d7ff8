"""Bytes into commands."""

from __future__ import annotations

import pytest
from ibfctl_simulator.galil.framing import Framing


def commands(*pieces: bytes, limit: int = 80) -> list[str | None]:
    framing = Framing(limit)
    found: list[str | None] = []
    for piece in pieces:
        framing.push(piece)
        try:
            while True:
                found.append(framing.next_command())
        except LookupError:
            continue
    return found


@pytest.mark.parametrize(
    ("pieces", "expected"),
    [
        ([b"TP\r"], ["TP"]),
        ([b"TP\r\n", b"SC\r\n"], ["TP", "SC"]),
        ([b"T", b"P", b"\r"], ["TP"]),
        ([b"TP;SC\r"], ["TP", "SC"]),
        ([b"TP;"], ["TP"]),
        ([b"TP;SC"], ["TP"]),
        ([b"TP;SC", b";"], ["TP", "SC"]),
        ([b"TP;\r"], ["TP", ""]),
        ([b"hswactA=0\n\r"], ["hswactA=0"]),
        ([b"\r"], [""]),
        ([b"\x12\x16\r"], ["\x12\x16"]),
        ([b"\n\n"], []),
    ],
)
def test_terminators(pieces, expected):
    assert commands(*pieces) == expected


def test_eighty_characters_pass_and_one_more_is_refused_as_one_line():
    line = b"SB1;" * 19 + b"SB1;"
    assert commands(line + b"\r") == ["SB1"] * 20 + [""]
    assert commands(line + b"S\r" + b"TP\r") == [None, "TP"]


def test_an_over_long_line_is_refused_once_however_it_arrives():
    assert commands(b"x" * 50, b"x" * 50, b"x" * 50, b"\rTP\r") == [None, "TP"]


def test_a_client_that_never_sends_cr_can_go_on_for_ever():
    assert commands(*[b"MG _TPA;"] * 100) == ["MG _TPA"] * 100


def test_a_client_that_never_sends_cr_survives_an_over_long_command():
    assert commands(b"x" * 100, b"xx;", b"TP;") == [None, "TP"]
