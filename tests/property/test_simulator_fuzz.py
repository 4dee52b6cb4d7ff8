"""No bytes and no order of commands can break the emulator."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ibfctl_simulator.galil.clock import SteppedClock
from ibfctl_simulator.galil.commands.request import Download
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.framing import Framing
from ibfctl_simulator.galil.inprocess import EmulatorServer
from ibfctl_simulator.galil.interpreter import Pending
from ibfctl_simulator.galil.programs.memory import Program
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.switches import SwitchPlaces

OPCODES = """
PV BT SH MO SP AC DC PA PR JG BG ST AB TP RP TE TD TV TT TS TB SC MG SB CB OB OP AO TM ER OE DP DE TH WH IH
QZ QR DR CM CD DT WC PT FE HM FI FL BL LD CN CW CF EO OC CO AQ KP MT HV TL DL UL LS LL XQ HX NO BN BP BV RS
JP JS EN RE RI ZS IF EL II WT AT AM MC AI AP AD DM DA LV LA TC ID
""".split()  # noqa: SIM905
WORDS = """
A B AB X C = ? , -1 0 1 2 100 2048 1e3 #A ( ) _PVA _BTB TIME @OUT[1] @IN[99] _XQ0 a[0] x " { {Z10.0} $FF
""".split()  # noqa: SIM905
PIECES = st.one_of(
    st.sampled_from([*WORDS, " "]), st.integers(-(2**40), 2**40).map(str), st.text(max_size=4)
)
COMMANDS = st.builds(
    lambda opcode, pieces: (opcode + "".join(pieces))[:80], st.sampled_from(OPCODES), st.lists(PIECES, max_size=8)
)
SENSIBLE = st.sampled_from(
    """
    SH PVA=100,50,20 PVB=-3,0,9 BTAB PVA=0,0,0 PVA=0,0,-1 JGA=5000 BGA STA AB1 PRB=900 BGB HMA FEB MOA CMAB
    CD5,-5=3 CD0,0=0 DT2 PTA=1 PAA=700 OEA=1 ERA=5 XQ HX DPA=9 FLA=50 QR TM500 TM1000 XQ0,1 BNA RS
    """.split()  # noqa: SIM905
)
LINES = st.text(alphabet=st.characters(max_codepoint=255, exclude_characters="\r\n\\"), max_size=90)
PROGRAM = ["#AUTO", "n=n+1;IF(n>3);SB1;ELSE;CB1;ENDIF", "WT 3;JP#AUTO", "#LIMSWI;CB1;RE", "#CMDERR;EN"]


def machine() -> Controller:
    places = SwitchPlaces(2000, -2000, 10, 400)
    controller = Controller(Settings(motor_on_at_start=True, switches=places))
    controller.engine.load(Program(PROGRAM))
    return controller


@given(st.lists(st.one_of(COMMANDS, SENSIBLE, st.integers(0, 300)), max_size=30))
@settings(max_examples=300, deadline=None)
def test_any_commands_in_any_order_get_a_prompt_and_leave_a_machine_that_runs(steps):
    controller = machine()
    for step in steps:
        if isinstance(step, int):
            controller.advance(step)
            continue
        reply = controller.reply(step, "A")
        if isinstance(reply, str):
            assert reply.endswith((":", "?")), step
            reply.encode("latin-1")
        else:
            assert isinstance(reply, Pending | Download)
    controller.advance(50)
    assert controller.reply("AB", "A") == ":"
    assert controller.reply("MG _BGA,_BGB", "A") == " 0.0000 0.0000\r\n:"


@given(st.lists(LINES, max_size=12))
@settings(max_examples=200, deadline=None)
def test_any_program_runs_or_is_refused(lines):
    controller = machine()
    try:
        program = Program(lines)
    except CommandError:
        return
    controller.engine.load(program)
    controller.reply("XQ", "A")
    controller.advance(40)
    assert controller.reply("MG _XQ0", "A").endswith("\r\n:")


@given(st.lists(st.lists(st.one_of(COMMANDS, SENSIBLE), max_size=4).map(";".join), max_size=10))
@settings(max_examples=200, deadline=None)
def test_any_program_of_real_commands_runs_or_stops(lines):
    controller = machine()
    controller.engine.load(Program([line[:80] for line in lines if "#A" not in line]))
    controller.reply("XQ", "A")
    controller.advance(100)
    assert controller.reply("HX", "A") == ":"


@given(st.lists(st.binary(max_size=200), max_size=10))
@settings(deadline=None)
def test_cutting_bytes_elsewhere_changes_no_command_of_lines_that_fit(pieces):
    data = b"".join(line[:80] + b"\r" for line in b"".join(pieces).replace(b"\r", b"").split(b"\n"))

    def commands(chunks):
        framing, found = Framing(80), []
        for chunk in chunks:
            framing.push(chunk)
            try:
                while True:
                    found.append(framing.next_command())
            except LookupError:
                continue
        return found

    assert commands([data]) == commands([data[i : i + 1] for i in range(len(data))])


@pytest.fixture(scope="module")
def server() -> Iterator[EmulatorServer]:
    with EmulatorServer(machine(), SteppedClock()) as running:
        yield running


@given(st.lists(st.one_of(st.binary(max_size=300), COMMANDS.map(lambda text: f"{text}\r".encode())), max_size=20))
@settings(max_examples=100, deadline=None)
def test_no_bytes_on_a_socket_stop_the_server(server, pieces):
    with contextlib.suppress(ConnectionError), socket.create_connection(("127.0.0.1", server.port), timeout=5) as bad:
        for piece in pieces:
            bad.sendall(piece)
    server.step(10)
    assert any(_answers(server) for _ in range(50))


def _answers(server: EmulatorServer) -> bool:
    """Ask on a new connection; what was sent before may still reset all connections, but not for ever."""
    with contextlib.suppress(ConnectionError), socket.create_connection(("127.0.0.1", server.port), timeout=5) as good:
        good.sendall(b"MG 1\r")
        return good.recv(100) == b" 1.0000\r\n:"
    return False
