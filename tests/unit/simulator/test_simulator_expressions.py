"""Expressions go left to right; `MG` prints them as the manuals show."""

from __future__ import annotations

import pytest
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.expressions import fixed


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1+2*3", 9.0),
        ("1+(2*3)", 7.0),
        ("10/4", 2.5),
        ("7%3", 1.0),
        ("-2*-3", 6.0),
        ("$FF+1", 256.0),
        ("$FFFFFFFF", -1.0),
        ("5>3", 1.0),
        ("5<=3", 0.0),
        ("3<>3", 0.0),
        ("6&3", 2.0),
        ("6|3", 7.0),
        ("@ABS[-3.5]", 3.5),
        ("@INT[3.9]+@FRAC[1.25]", 3.25),
        ("@SIN[30]", 0.5),
        ("((1+1))*2", 4.0),
        ("@OUT[-1]", 0.0),
        ("@IN[1]", 1.0),
    ],
)
def test_values(console, text, value):
    assert console.number(text) == pytest.approx(value, abs=1e-4)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("nothere", 9),
        ("1+", 4),
        ("(1+2", 59),
        ("1)", 59),
        ("@WHAT[1]", 57),
        ("_GNX", 58),
        ("_TPC", 58),
        ("1/0", 6),
        ("2147483647*2", 6),
        ("@OUT[81]", 6),
        ("1 2", 4),
        ("#", 4),
        ("a[1]", 57),
        ("(" * 40 + "1", 59),
        ("-" * 60 + "1", 4),
    ],
)
def test_errors(console, text, code):
    assert console.code(f"MG {text}") == code


def test_numbers_are_fixed_point():
    assert fixed(1 / 3) == 21845 / 65536
    with pytest.raises(CommandError):
        fixed(float("nan"))


def test_variables_are_case_sensitive_and_unknown_ones_are_refused(console):
    console.good("homedA=3", "homeda=homedA*2")
    assert (console.number("homedA"), console.number("homeda")) == (3.0, 6.0)
    assert console("homedA=?") == "3.0000\r\n:"
    assert console.code("HOMED=?") == 9


def test_a_setting_that_names_an_axis_is_no_variable_but_a_digit_makes_one(console):
    console.good("ACA=2048", "CD0=5")
    assert console.number("_ACA") == 2048
    assert console.number("CD0") == 5


@pytest.mark.parametrize(
    ("command", "line"),
    [
        ("MG 1,2", " 1.0000 2.0000"),
        ("MG -1", "-1.0000"),
        ('MG "abc"', "abc"),
        ('MG "abc",5', "abc 5.0000"),
        ('MG "a,b"', "a,b"),
        ("MG{Z10.0}_PVA", " 255"),
        ("MG{F5.1}2.5", " 00002.5"),
        ("MG {^65}", "A"),
        ("MG_TM", " 1000.0000"),
    ],
)
def test_messages(console, command, line):
    assert console(command) == f"{line}\r\n:"


@pytest.mark.parametrize(("command", "code"), [("MG", 50), ('MG "abc', 52), ("MG {Q}1", 53), ('MG a"b"', 4)])
def test_bad_messages(console, command, code):
    assert console.code(command) == code


def test_the_leading_blank_is_a_setting(make_console):
    assert make_console(message_leading_blank=False)("MG 1,-2") == "1.0000 -2.0000\r\n:"
