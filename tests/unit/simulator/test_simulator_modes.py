"""Contour mode, position tracking, homing, limits and the error limit."""

from __future__ import annotations

import pytest
from ibfctl_simulator.galil.servo import ServoModel
from ibfctl_simulator.galil.switches import SwitchPlaces


@pytest.fixture
def switched(make_console):
    """Limit switches at +-5000, home switch from 1000 on, an index every 400 counts."""
    console = make_console(switches=SwitchPlaces(5000, -5000, 1000, 400))
    console.good("SH", "SP 8192,8192", "AC 1024000,1024000", "DC 1024000,1024000")
    return console


# Contour mode


def test_the_manuals_contour_example(console):
    console.good("CM A", "DT -1", "CD 48=2", "CD 240=3", "CD 48=4", "CD 0=0")
    console.controller.advance(10)
    assert (console("TPA"), console.number("_CM")) == ("0\r\n:", 507)
    console.good("DT 1")
    console.controller.advance(4)
    assert console("TPA") == "48\r\n:"
    console.controller.advance(4)
    assert console("TPA") == "168\r\n:"
    console.controller.advance(4)
    assert console("TPA") == "288\r\n:"
    console.controller.advance(17)
    assert (console("TPA"), console("SCA"), console.number("_CM")) == ("336\r\n:", "51\r\n:", 511)
    assert console.number("_BGA") == 0


def test_contour_without_data_holds_and_waits(console):
    console.good("CM AB", "CD 10,-20=1")
    console.controller.advance(50)
    assert (console("TP"), console("SCA"), console.number("_CM")) == ("10, -20\r\n:", "50\r\n:", 511)
    console.good("DT 3", "CD 8,8")
    console.controller.advance(4)
    assert console("TP") == "14, -16\r\n:"
    console.controller.advance(4)
    assert console("TP") == "18, -12\r\n:"


def test_contour_takes_511_records_for_all_axes_together(console):
    console.good("CM AB", "DT -1", *["CD 1,1=1"] * 511)
    assert console.number("_CM") == 0
    assert console.code("CD 1,1=1") == 32


@pytest.mark.parametrize(
    ("command", "code"),
    [("CD 32763=1", 41), ("CD 1=9", 6), ("CD ,1=1", 4), ("CD", 50), ("CM B", 18), ("PAA=5", 7), ("BTA", 21)],
)
def test_what_contour_mode_refuses(console, command, code):
    console.good("CM A")
    assert console.code(command) == code


def test_a_record_without_a_mode_or_a_time_is_refused(console):
    assert console.code("CD 1=1") == 41
    console.good("CM A", "DT -1")
    assert console.code("CD 1") == 39


def test_a_blank_decides_between_a_record_and_a_variable(console):
    console.good("CM A", "CD0=0")
    console.controller.advance(5)
    assert console("SCA") == "50\r\n:"
    console.good("CD 0=0")
    console.controller.advance(5)
    assert console("SCA") == "51\r\n:"


def test_stop_leaves_contour_mode(console):
    console.good("CM A", "CDA=32000=8", "CDA=32000=8")
    console.controller.advance(100)
    console.good("DCA=1073740800", "STA")
    console.controller.advance(10)
    assert (console("SCA"), console.number("_CM"), console.number("_BGA")) == ("4\r\n:", 511, 0)
    assert console.code("CD 1=1") == 41


# Position tracking


def test_tracking_starts_at_once_and_follows_new_targets(console):
    console.good("PTA=1", "PAA=10000")
    console.controller.advance(100)
    assert console.number("_BGA") == 1
    console.good("PAA=-2000")
    console.controller.advance(4000)
    assert (console("TPA"), console.number("_BGA")) == ("-2000\r\n:", 0)
    console.good("PAA=50")
    console.controller.advance(4000)
    assert console("TPA") == "50\r\n:"


def test_stop_leaves_tracking(console):
    console.good("PTA=1", "PAA=10000", "STA")
    console.controller.advance(1000)
    assert console.number("_PTA") == 0


# Limits


def test_a_limit_switch_decelerates_and_leaves_the_way_back(switched):
    switched.good("PAA=9000", "BGA")
    while switched.number("_SCA") == 0:
        switched.controller.advance(1)
    assert (switched("SCA"), switched.number("_BGA"), switched.number("_LFA")) == ("2\r\n:", 1, 0)
    assert 5000 < switched.axis.commanded_counts <= 5000 + 8192 / 1024
    switched.controller.advance(100)
    # 8192^2 / (2 * 1024000) is 32.8 counts.
    assert switched.number("_BGA") == 0
    assert 5032 <= switched.axis.commanded_counts <= 5042
    assert switched.code("BGA") == 22
    switched.good("PAA=0", "BGA")
    switched.controller.advance(2000)
    assert (switched("TPA"), switched.number("_LFA")) == ("0\r\n:", 1)


def test_a_limit_ends_pvt_and_empties_the_buffer(switched):
    switched.good(*["PVB=-800,-8192,100"] * 20, "BTB")
    switched.controller.advance(1000)
    assert (switched("SCB"), switched.number("_PVB"), switched.number("_BGB")) == ("3\r\n:", 255, 0)


def test_limits_can_be_disabled_per_direction(switched):
    switched.good("LDA=1", "PAA=6000", "BGA")
    switched.controller.advance(3000)
    assert (switched("TPA"), switched("SCA")) == ("6000\r\n:", "1\r\n:")


def test_software_limits(console):
    console.good("FLA=300.0000", "BLA=-300", "PAA=1000", "DCA=1073740800", "BGA")
    console.controller.advance(1000)
    assert console("SCA") == "2\r\n:"
    assert 300 < console.axis.commanded_counts < 330
    console.good("PAA=-1000", "BGA")
    console.controller.advance(1000)
    assert console("SCA") == "3\r\n:"


def test_off_on_error_2_switches_the_motor_off_at_a_limit(switched):
    switched.good("OEA=2", "PAA=9000", "BGA")
    switched.controller.advance(2000)
    assert (switched("SCA"), switched.number("_MOA")) == ("2\r\n:", 1)


def test_switches_stay_where_they_are_when_the_position_is_redefined(switched):
    switched.good("DPA=100000", "PRA=6000", "BGA")
    switched.controller.advance(3000)
    assert switched("SCA") == "2\r\n:"
    assert 105_000 < switched.axis.commanded_counts < 105_050


# Error limit


def test_the_error_limit_switches_the_motor_off_with_code_8(make_console):
    slow = ServoModel(kind="lag", time_constant_s=0.05)
    console = make_console(servo=slow)
    console.good("SHA", "OEA=1", "ERA=200", "SPA=20000", "PAA=20000", "BGA")
    console.controller.advance(500)
    assert (console("SCA"), console.number("_MOA"), console.number("_BGA")) == ("8\r\n:", 1, 0)


def test_without_off_on_error_the_axis_goes_on(make_console):
    console = make_console(servo=ServoModel(kind="lag", time_constant_s=0.05))
    console.good("SHA", "ERA=200", "SPA=20000", "PAA=20000", "BGA")
    console.controller.advance(500)
    assert console.number("_BGA") == 1
    console.controller.advance(1600)
    assert (console("TPA"), console("SCA")) == ("20000\r\n:", "1\r\n:")


# Homing


def test_find_edge_stops_behind_the_edge_with_code_9(switched):
    switched.good("FEA", "BGA")
    assert switched.number("_HMA") == 0
    switched.controller.advance(1000)
    assert (switched("SCA"), switched.number("_HMA"), switched.number("_BGA")) == ("9\r\n:", 1, 0)
    assert 1000 < switched.axis.commanded_counts < 1050


def test_find_edge_comes_from_the_other_side_too(switched):
    switched.good("DPA=-3000", "PAA=0", "BGA")
    switched.controller.advance(1000)
    switched.good("FEA", "BGA")
    switched.controller.advance(1000)
    assert (switched("SCA"), switched.number("_HMA")) == ("9\r\n:", 0)
    assert 950 < switched.axis.physical_counts < 1000


def test_find_index_stops_on_the_pulse_and_calls_it_zero(switched):
    switched.good("DPA=150", "JGA=2048", "FIA", "BGA")
    switched.controller.advance(1000)
    assert switched("SCA") == "10\r\n:"
    assert switched("TPA") == "0\r\n:"
    assert switched.axis.physical_counts % 400 <= 2


def test_home_finds_edge_then_index(switched):
    switched.good("HVA=512", "HMA", "BGA")
    switched.controller.advance(5000)
    assert (switched("SCA"), switched("TPA"), switched.number("_BGA")) == ("10\r\n:", "0\r\n:", 0)
    assert 1200 <= switched.axis.physical_counts <= 1201


def test_homing_is_ended_by_stop(switched):
    switched.good("HMA", "BGA")
    switched.controller.advance(20)
    switched.good("STA")
    switched.controller.advance(3000)
    assert (switched("SCA"), switched.number("_BGA")) == ("4\r\n:", 0)


def test_servo_on_takes_the_present_position_as_its_target(make_console):
    console = make_console(servo=ServoModel(kind="lag", time_constant_s=0.05))
    console.good("SHA", "PAA=20000", "SPA=100000", "ACA=1024000", "BGA")
    console.controller.advance(100)
    console.good("MOA")
    assert abs(console.number("_TEA")) > 100
    console.good("SHA")
    assert console.number("_TEA") == 0
    console.controller.advance(100)
    assert console.number("_TEA") == 0


def test_a_contour_ends_the_old_way_too(console):
    console.good("CM A", "CD 4", "DT 0", "CD 0")
    console.controller.advance(5)
    assert (console("TPA"), console("SCA")) == ("4\r\n:", "51\r\n:")


def test_the_torque_limit_slows_the_load(make_console):
    tracks = []
    for volts in (9.9982, 1):
        console = make_console(servo=ServoModel(kind="second_order", acceleration_limit_counts_s2=1e6))
        console.good("SHA", f"TLA={volts}", "SPA=100000", "ACA=1024000", "PAA=50000", "BGA")
        console.controller.advance(100)
        tracks.append(console.number("_TPA"))
    assert tracks[1] < 0.5 * tracks[0]
