"""DMC programs: flow, threads, trippoints, automatic subroutines."""

from __future__ import annotations

import pytest
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.programs.memory import Program
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.switches import SwitchPlaces


@pytest.fixture
def run(console):
    """Load a program, start it at its first line in thread 0, let samples pass."""

    def run(*lines, samples=10):
        console.controller.engine.load(Program(lines))
        console.good("XQ")
        console.controller.advance(samples)
        return console

    return run


@pytest.fixture
def heard(console):
    """Text that nobody asked for, as the client on handle A gets it."""
    pieces = []
    console.controller.handles.open("127.0.0.1", 1, pieces.append, lambda: None, lambda: None)
    console.good("CFA")
    return pieces


# Flow


def test_statements_run_in_order_and_the_thread_ends(run):
    console = run("#A;x=1", "x=x*5;y=x+1", "EN")
    assert (console.number("x"), console.number("y"), console.number("_XQ0")) == (5, 6, -1)


@pytest.mark.parametrize(("value", "branch"), [(1, 10), (2, 20), (3, 30)])
def test_nested_conditions(run, value, branch):
    console = run(
        f"v={value}",
        "IF (v=1)",
        "r=10",
        "ELSE",
        "IF (v=2);r=20;ELSE;r=30;ENDIF",
        "ENDIF",
        "EN",
    )
    assert console.number("r") == branch


def test_conditions_go_left_to_right_without_precedence(run):
    assert run("IF 1+1*2=4;r=1;ELSE;r=0;ENDIF", "EN").number("r") == 1


def test_loops_and_subroutines(run):
    console = run("n=0;s=0", "#LOOP", "JS #ADD", "JP #LOOP,n<5", "EN", "#ADD", "n=n+1;s=s+n", "EN")
    assert (console.number("n"), console.number("s")) == (5, 15)


def test_a_conditional_call_and_a_jump_to_a_line(run):
    console = run("x=0", "JS#SUB,x=1", "JP 4", "x=99", "EN", "#SUB;x=50;EN")
    assert console.number("x") == 0


def test_arrays(run):
    console = run("DM a[3]", "a[0]=1;a[2]=a[0]+1", "EN")
    assert [console.number(f"a[{i}]") for i in (0, 1, 2, -1)] == [1, 0, 2, 3]
    assert console.code("a[3]=1") == 56
    assert console("LA") == "a[3]\r\n:"
    console.good("DA a[]")
    assert console.code("MG a[0]") == 57


def test_comments_and_blank_lines_do_nothing(run):
    assert run("'only a comment; x=1", "", "NO x=2", "x=3 ' and why", "EN").number("x") == 3


def test_a_program_that_ends_without_en_ends(run):
    assert run("x=1").number("_XQ0") == -1


@pytest.mark.parametrize(
    ("lines", "code"),
    [
        (["JP #NO"], 10),
        (["JP 99"], 11),
        (["#A;JS#A"], 12),
        (["IF 0;x=1"], 63),
        (["SPA=-1"], 6),
        (["XX"], 1),
        (["UL"], 3),
        (["RE"], 2),
    ],
)
def test_a_failing_statement_ends_the_thread_and_says_where(run, heard, lines, code):
    console = run("WT 1", *lines, "EN")
    assert console.number("_XQ0") == -1
    assert console.number("_TC") == code
    assert console.number("_ED") == 1
    assert b"".join(heard).startswith(b"?1 ")


def test_flow_is_for_programs_alone(console):
    assert [console.code(command) for command in ("JP #A", "EN", "IF 1", "ELSE", "RE", "ZS")] == [2] * 6


# Threads


def test_eight_threads_run_side_by_side(console):
    lines = ["#A", "n=n+1", "WT 10", "JP #A"]
    console.good("n=0")
    console.controller.engine.load(Program(lines))
    console.good(*[f"XQ #A,{thread}" for thread in range(8)])
    assert console.code("XQ #A,3") == 19
    assert console.code("XQ #A,8") == 6
    console.controller.advance(5)
    assert (console.number("n"), console.number("_NO")) == (8, 255)
    console.good("HX 3")
    console.controller.advance(10)
    assert (console.number("n"), console.number("_NO"), console.number("_HX0")) == (15, 255 - 8, 2)
    console.good("HX")
    assert console.number("_NO") == 0


def test_threads_share_a_sample_fairly(make_console):
    console = make_console(commands_per_sample=4)
    console.good("p=0", "q=0")
    console.controller.engine.load(Program(["#P;p=p+1;JP#P", "#Q;q=q+1;JP#Q"]))
    console.good("XQ#P,0", "XQ#Q,1")
    console.controller.advance(300)
    assert console.number("p") == console.number("q") == 300


def test_loading_while_a_program_runs_is_refused(console):
    console.controller.engine.load(Program(["#A;WT1000;JP#A"]))
    console.good("XQ")
    assert console.code("DL") == 17
    assert console.code("BN") == 17


def test_abort_halts_programs_unless_told_not_to(console):
    console.controller.engine.load(Program(["#A;WT1000;JP#A"]))
    console.good("XQ")
    console.good("AB1")
    assert console.number("_XQ0") == 0
    console.good("AB")
    assert console.number("_XQ0") == -1


# Trippoints


def test_wt_waits_samples_and_am_waits_for_the_end_of_motion(run):
    console = run("PAA=1000;BGA;AMA", "t=TIME;WT 100", "u=TIME", "EN", samples=3000)
    assert console.number("u") - console.number("t") == 100
    assert 100 < console.number("t") < 500


def test_wt_follows_the_sample_period(make_console):
    console = make_console()
    console.good("TM 500")
    console.controller.engine.load(Program(["t=TIME;WT 100", "u=TIME-t", "EN"]))
    console.good("XQ")
    console.controller.advance(400)
    assert console.number("u") == 200


def test_at_makes_a_steady_beat(run):
    console = run("n=0;AT 0", "#A;AT -50", "n=n+1;JP#A,n<10", "t=TIME", "EN", samples=1000)
    assert console.number("t") == 500


def test_ai_waits_for_an_input(run):
    console = run("AI -3", "x=TIME", "EN", samples=100)
    assert console.code("MG x") == 9
    console.state.set_input(3, 0)
    console.controller.advance(1)
    assert console.number("x") == 100


def test_a_trippoint_for_a_position(run):
    console = run("PAA=20000;BGA;APA=5000", "x=_RPA", "EN", samples=2000)
    assert 5000 <= console.number("x") < 5100


def test_the_result_does_not_depend_on_how_time_is_cut(make_console):
    outcomes = []
    for cut in (1, 7, 4000):
        console = make_console()
        console.good("SH")
        console.controller.engine.load(
            Program(["n=0", "#A", "PRA=100;BGA;AMA", "WT 3;n=n+1;SB n", "JP#A,n<9", "t=TIME", "EN"])
        )
        console.good("XQ")
        for _ in range(4000 // cut + 1):
            console.controller.advance(cut)
        outcomes.append((console.number("t"), console("TPA"), console.state.outputs))
    assert outcomes[0] == outcomes[1] == outcomes[2]


# Automatic subroutines


@pytest.fixture
def limited():
    """Limit switches at +-500, a program in thread 0."""

    def start(*lines):
        settings = Settings(motor_on_at_start=True, switches=SwitchPlaces(500, -500))
        return Controller(settings, program=Program(lines))

    return start


def test_auto_runs_at_power_up_and_limswi_interrupts_it(limited):
    controller = limited(
        "#AUTO", "SB 1;JGA=10000;BGA", "#L;WT 100;JP#L", "#LIMSWI", "CB 1;f=_SCA;RE"
    )
    controller.advance(10)
    assert controller.state.output(1) == 1
    controller.advance(200)
    assert controller.state.output(1) == 0
    assert controller.state.variables["f"] == 2
    assert controller.engine.line_of(0) == 2


def test_re_1_goes_on_with_the_trippoint_and_re_does_not(limited):
    for ending, after in (("RE 1", 1000), ("RE", None)):
        controller = limited("#AUTO", "JGA=10000;BGA", "WT 1000;t=TIME", "EN", "#LIMSWI", ending)
        controller.advance(2000)
        time = controller.state.variables["t"]
        assert time == after if after else time < 200


def test_poserr(console):
    console.good("ERA=100")
    console.controller.engine.load(Program(["#A;WT 1000;JP#A", "#POSERR;CB 1;e=_TEA;RE"]))
    console.good("SB 1", "XQ")
    console.axis.servo.disturbance_counts = 150
    console.controller.advance(5)
    assert (console.number("@OUT[1]"), console.number("e")) == (0, 150)


def test_tcperr_knows_the_handle(console):
    console.controller.engine.load(Program(["#A;WT 1000;JP#A", "#TCPERR;h=_IA4;RE"]))
    console.good("XQ")
    console.controller.lost("C")
    console.controller.advance(2)
    assert (console.number("h"), console.number("_TC")) == (2, 123)


def test_inint_only_for_watched_inputs_and_once_per_edge(console):
    console.controller.engine.load(Program(["n=0;II 2,3", "#A;WT 1000;JP#A", "#ININT;n=n+1;RI"]))
    console.good("XQ")
    console.controller.advance(2)
    for number in (1, 2, 2, 3):
        console.state.set_input(number, 0)
        console.controller.advance(2)
    assert console.number("n") == 2


def test_cmderr_sees_code_and_line_and_returns_behind_the_error(console):
    console.controller.engine.load(
        Program(["#A;WT 1", "SPA=-1;x=7", "EN", "#CMDERR;c=_TC;l=_ED;EN"])
    )
    console.good("XQ")
    console.controller.advance(10)
    assert [console.number(name) for name in ("c", "l", "x", "_XQ0")] == [6, 1, 7, -1]


def test_an_error_in_another_thread_interrupts_thread_0(console):
    console.controller.engine.load(
        Program(["#A;WT 1000;JP#A", "#B;SPA=-1;EN", "#CMDERR;c=_TC;t=_ED1;EN"])
    )
    console.good("XQ#A,0", "XQ#B,2")
    console.controller.advance(10)
    assert [console.number(name) for name in ("c", "t", "_XQ2", "_XQ0")] == [6, 2, -1, 0]


def test_an_automatic_subroutine_does_not_interrupt_itself(console):
    console.controller.engine.load(Program(["n=0", "#A;WT 1000;JP#A", "#TCPERR;n=n+1;WT 50;RE"]))
    console.good("XQ")
    console.controller.advance(5)
    for _ in range(3):
        console.controller.lost("A")
        console.controller.advance(5)
    assert console.number("n") == 1


# Messages


def test_messages_go_to_the_console_handle_marked_or_plain(run, heard):
    run("CW 1", 'MG "a",1', "CW 2", 'MG "b"{N}', 'MG {EA}"c"', "EN")
    assert heard == [bytes(byte | 0x80 for byte in b"a 1.0000\r\n"), b"b", b"c\r\n"]


def test_without_a_console_handle_messages_are_lost(run, heard, console):
    console.good("CF S")
    run('MG "x"', "EN")
    assert heard == []


# Memory


@pytest.mark.parametrize(
    ("lines", "code"),
    [
        (["x" * 81], 60),
        (["NO"] * 2001, 60),
        (["#A", "#A"], 61),
        (["#TOOLONGLABEL"], 11),
        (["#1"], 11),
        ([f"#L{i}" for i in range(511)], 62),
    ],
)
def test_programs_that_do_not_fit(lines, code):
    with pytest.raises(CommandError) as caught:
        Program(lines)
    assert caught.value.code == code


def test_restart_takes_up_what_was_burned_and_forgets_the_rest(console):
    console.controller.engine.load(Program(["#AUTO;started=1;EN"]))
    console.good("SPA=1000", "kept=5", "BV", "BN", "SPA=2000", "lost=6", "SB 1")
    reply = console.controller.reply("BP", "A")
    assert not isinstance(reply, str)
    console.controller.advance(2048)
    assert reply.wait.done()
    console.good("RS")
    console.controller.advance(5)
    assert [console.number(name) for name in ("_SPA", "kept", "started", "@OUT[1]", "TIME")] == [1000, 5, 1, 0, 5]
    assert console.code("MG lost") == 9


def test_listings(run):
    console = run("#A;b=2;a=1", "EN")
    assert console("LV") == "a= 1.0000\r\nb= 2.0000\r\n:"
    assert console("LS") == "0 #A;b=2;a=1\r\n1 EN\r\n:"
    assert console("LL") == "#A=0\r\n:"
    console.good("DA *")
    assert console.code("MG a") == 9


def test_a_program_waits_for_a_place_in_the_contour(console):
    console.controller.engine.load(Program(["n=0", "#L;WC;CD 2=1;n=n+1;JP#L,n<600", "WC;CD 0=0", "EN"]))
    console.good("CM A", "XQ")
    console.controller.advance(1500)
    assert (console("TPA"), console("SCA"), console.number("n")) == ("1200\r\n:", "51\r\n:", 600)


def test_a_trippoint_for_a_distance(run):
    console = run("DPA=500;PAA=-20000;BGA;ADA=3000", "x=_RPA", "EN", samples=2000)
    assert -2600 < console.number("x") <= -2500


def test_re_leaves_the_subroutines_that_the_interrupt_called(console):
    console.controller.engine.load(
        Program(["#A;WT 1000;JP#A", "#TCPERR;JS #CLEAN", "EN", "#CLEAN;x=1;RE"])
    )
    console.good("XQ")
    console.controller.lost("A")
    console.controller.advance(5)
    assert (console.number("x"), console.number("_XQ0")) == (1, 0)


# A statement that jumps to itself while a count has not been reached


def test_a_thread_that_spins_on_a_count_goes_on_in_the_sample_of_the_count(console):
    lines = ["#A", "JP #A,_BTA<n", "SB 1;at=TIME", "#B", "JP #B,_BTA>=1", "again=TIME", "EN"]
    console.controller.engine.load(Program(lines))
    console.good("n=2", "PVA=10,0,30", "PVA=10,0,30", "PVA=10,0,30", "PVA=0,0,0", "BT A", "XQ #A,1")
    begun = console.number("TIME")
    console.controller.advance(200)
    assert (console.number("at") - begun, console.state.output(1)) == (60, 1)
    assert console.number("_XQ1") == 4
    console.good("PVA=10,0,30", "PVA=0,0,0", "BT A")
    again = console.number("TIME")
    console.controller.advance(5)
    assert console.number("again") == again


def test_a_count_that_is_changed_by_hand_ends_the_spin(console):
    console.controller.engine.load(Program(["#A", "JP #A,_BTA<n", "SB 1", "EN"]))
    console.good("n=9", "PVA=10,0,30", "PVA=10,0,30", "PVA=0,0,0", "BT A", "XQ #A,1")
    console.controller.advance(40)
    assert console.state.output(1) == 0
    console.good("n=1")
    console.controller.advance(1)
    assert console.state.output(1) == 1
