"""Settings, moves, outputs and questions, without sockets."""

from __future__ import annotations

import pytest


def test_rejections_latch_a_code_that_reading_clears(console):
    assert console("bg") == "?"
    assert console.number("_TC") == 1
    assert console("TC1").startswith("1 ")
    assert console("TC 0") == "0\r\n:"


def test_an_empty_command_is_good(console):
    assert console("") == ":"


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("ACA=?", "72704"),
        ("AC ?,?", "72704, 256000"),
        ("SP ?", "25000"),
        ("QZ", "2, 52, 26, 36"),
        ("TM ?", "1000"),
        ("\x12\x16", "DMC4020 Rev 1.3a"),
        ("TP", "0, 0"),
        ("TP B", "0"),
        ("TEXY", "0, 0"),
        ("ERA=?", "16384"),
    ],
)
def test_answers(console, command, answer):
    console.good("ACA=73422")
    assert console(command) == f"{answer}\r\n:"


def test_settings_by_position_skip_empty_fields(console):
    console.good("SP 1000.9,2001", "SP ,3000")
    assert console("SP ?,?") == "1000, 3000\r\n:"


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("SPA=22000002", 6),
        ("ACA=1000", 6),
        ("OEA=4", 6),
        ("ERA=0", 6),
        ("SP", 50),
        ("SP 1,2,3", 4),
        ("SPC=1", 4),
        ("BG C", 4),
        ("BG Q", 4),
        ("XX", 1),
        ("TM 10", 6),
        ("SB 81", 6),
        ("SB", 50),
        ("OB 1", 50),
        ("OP 65536", 6),
        ("TC 2", 6),
        ("IHQ=>-3", 4),
        ("AB 2", 6),
        ("DPA=3000000000", 6),
    ],
)
def test_rejected_settings(console, command, code):
    assert console.code(command) == code


def test_the_error_limit_can_be_switched_off(console):
    console.good("ERA=-1")
    assert console("ERA=?") == "-1\r\n:"


def test_an_absolute_move_arrives_with_code_1(console):
    console.good("SPA=20000", "ACA=102400", "DCA=102400", "PAA=4000", "BGA")
    assert (console.number("_BGA"), console("SCA")) == (1, "0\r\n:")
    # 4000/20000 s at speed and 20000/102400 s for the ramps: 0.395 s.
    console.controller.advance(404)
    assert console.number("_BGA") == 1
    console.controller.advance(1)
    assert (console("TPA"), console("SCA"), console.number("_BGA")) == ("4000\r\n:", "1\r\n:", 0)


def test_a_relative_move_adds_up(console):
    for _ in range(2):
        console.good("PRA=-500", "BGA")
        console.controller.advance(2000)
    assert console("TPA") == "-1000\r\n:"


@pytest.mark.parametrize(
    ("command", "code"),
    [("PAA=1", 7), ("PRA=1", 7), ("SPA=2", 7), ("DPA=0", 7), ("JGA=5", 13), ("BGA", 21), ("TM 500", 7)],
)
def test_what_a_moving_axis_refuses(console, command, code):
    console.good("PAA=100000", "BGA")
    assert console.code(command) == code


def test_segments_and_decelerations_are_taken_while_moving(console):
    console.good("PAA=100000", "BGA", "PVA=1,0,2", "ACA=1024", "DCA=1073740800")


def test_a_jog_runs_changes_and_stops_with_code_4(console):
    console.good("JGA=2048", "ACA=204800", "DCA=204800", "BGA")
    console.controller.advance(1024)
    assert console.number("_TVA") == 2048
    console.good("JGA=-1024")
    console.controller.advance(1024)
    assert console.number("_TVA") == -1024
    console.good("STA")
    console.controller.advance(100)
    assert (console.number("_BGA"), console("SCA")) == (0, "4\r\n:")


def test_begin_starts_all_or_none(console):
    console.good("PA 100,100", "MOB")
    assert console.code("BGAB") == 20
    assert console.number("_BGA") == 0


def test_motors_are_off_after_power_up_unless_set_otherwise(make_console):
    assert make_console().number("_MOA") == 1
    assert make_console(motor_on_at_start=True).number("_MOA") == 0


def test_outputs_by_bit_expression_and_word(console):
    console.good("SB 3", "OB 1,@OUT[3]", "OB2,0")
    assert [console.number(f"@OUT[{n}]") for n in (1, 2, 3)] == [1, 0, 1]
    console.good("CB3", "OP 2")
    assert [console.number(f"@OUT[{n}]") for n in (1, 2, 3)] == [0, 1, 0]
    assert console.state.outputs == 2


def test_time_counts_samples(console):
    console.controller.advance(1500)
    assert console.number("TIME") == 1500


def test_the_sample_period_follows_tm(console):
    assert console.state.sample_period_s == 1 / 1024
    console.controller.advance_to(1.0)
    console.good("TM 500")
    assert console.number("_TM") == 500
    console.controller.advance_to(2.0)
    assert console.number("TIME") == 1024 + 2048


def test_time_never_runs_ahead_of_the_clock(console):
    console.controller.advance_to(0.9999 / 1024)
    assert console.number("TIME") == 0
    console.controller.advance_to(1 / 1024)
    assert console.number("TIME") == 1


def test_a_41x3_with_eight_axes_says_so(make_console):
    console = make_console(family="41x3", axes=8)
    assert console("\x12\x16") == "DMC4183 Rev 1.3a\r\n:"
    assert console("TP") == "0, 0, 0, 0, 0, 0, 0, 0\r\n:"


@pytest.mark.parametrize(
    ("commands", "question", "answer"),
    [
        (["CN 1,,-1"], "CN ?,?,?", "1, -1, -1"),
        (["CN ,,,1"], "MG _CN3", " 1.0000"),
        (["AQ 2,1"], "MG _AQ2", " 1.0000"),
        (["CW 1"], "CW ?", "1"),
        (["CW ,1", "EO 0", "CO 3", "NO anything"], "CW ?", "2"),
        (["AO 3,-2.5"], "MG @AO[3]", "-2.5000"),
        ([], "MG @AN[1]", " 0.0000"),
        (["DPB=-7"], "DP ?,?", "0, -7"),
        (["DE ,12"], "DE ?,?", "0, 12"),
        (["PVA=1,0,2"], "PVA=?", "254"),
        ([], "CM ?", "511"),
        (["DT 3"], "DT ?", "3"),
        (["TL 5.5"], "TLA=?", "5.5"),
        ([], "TT", "0.0000, 0.0000"),
        (["MTB=-2.5"], "MT ?,?", "1, -2.5"),
        ([], "MG _LFA,_LRB", " 1.0000 1.0000"),
    ],
)
def test_what_is_set_is_read_back(console, commands, question, answer):
    console.good(*commands)
    assert console(question) == f"{answer}\r\n:"


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("CN 1,1,1,1,1,1", 4),
        ("AQ 2", 50),
        ("AQ 9,1", 6),
        ("OCA=1,2,3", 4),
        ("CF Q", 4),
        ("CW", 50),
        ("CW 3", 6),
        ("EO 2", 6),
        ("AO 1", 50),
        ("AO 1,11", 6),
        ("IH", 4),
        ("DR", 50),
        ("DR 1", 6),
        ("DR 10,8", 6),
        ("TM", 50),
        ("AI 0", 6),
        ("AP 1,1", 4),
        ("DM x", 57),
        ("DM x[24001]", 6),
        ("DM x[20000],y[20000]", 66),
        ("DA 1x", 9),
        ("x[0]=1", 57),
        ("DL 5", 4),
        ("XQ", 10),
        ("QR Q", 4),
        ("II", 50),
        ("II 5,3", 6),
    ],
)
def test_what_is_refused(console, command, code):
    assert console.code(command) == code


def test_variables_run_out(console):
    console.good(*[f"v{number}=0" for number in range(510)])
    assert console.code("w=0") == 67
    console.good("DA v7", "w=0")


def test_a_41x3_has_no_extended_io(make_console):
    console = make_console(family="41x3")
    assert (console.code("CO 1"), console.code("MG _CO")) == (1, 58)


def test_an_axis_that_the_model_lacks_can_have_another_error(make_console):
    assert make_console(missing_axis_error=1).code("SPC=1") == 1


def test_a_contour_needs_the_motor(console):
    console.good("MOB")
    assert console.code("CM AB") == 20


def test_a_move_at_no_speed_gets_nowhere_until_it_is_stopped(console):
    console.good("SPA=0", "PAA=100", "BGA")
    console.controller.advance(5000)
    assert (console("TPA"), console.number("_BGA")) == ("0\r\n:", 1)
    console.good("STA")
    assert (console("TPA"), console.number("_BGA"), console("SCA")) == ("0\r\n:", 0, "4\r\n:")
