"""Everything that can be made to go wrong, through the back door."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from ibfctl_simulator.galil.control import COMMANDS


def test_delayed_replies_come_late_complete_and_in_order(server, connect):
    slow, quick = connect(), connect()
    assert slow.ask("WH\r") == "IHA\r\n:"
    server.fault("delay seconds=0.3 handle=A")
    begin = time.monotonic()
    assert slow.ask("MG 1\rMG 2\rMG 3\r", 3) == " 1.0000\r\n: 2.0000\r\n: 3.0000\r\n:"
    assert time.monotonic() - begin >= 0.3
    begin = time.monotonic()
    quick.ask("MG 1\r")
    assert time.monotonic() - begin < 0.3


def test_a_delay_does_not_slow_the_command_itself(server, client):
    server.fault("delay seconds=60")
    client.socket.sendall(b"SB 1\r")
    begin = time.monotonic()
    while not server.call(lambda: server.controller.state.output(1)):
        assert time.monotonic() - begin < 5
    client.socket.settimeout(0.05)
    with pytest.raises(TimeoutError):
        client.socket.recv(1)


def test_dropped_replies(server, client):
    server.fault("drop replies=2")
    assert client.ask("MG 1\rMG 2\rMG 3\r", 1) == " 3.0000\r\n:"


def test_garbled_replies(server, client):
    server.fault("garble")
    client.socket.sendall(b"MG 1\r")
    assert client.socket.recv(100) == bytes(byte ^ 0x55 for byte in b" 1.0000\r\n:")
    assert client.ask("MG 1\r") == " 1.0000\r\n:"


def test_stale_replies(server, client):
    client.ask("MG 1\r")
    server.fault("stale")
    assert client.ask("MG 2\r") == " 1.0000\r\n:"
    assert client.ask("MG 3\r") == " 3.0000\r\n:"


def test_merged_replies(server, client):
    server.fault("merge")
    client.socket.sendall(b"MG 1\r")
    server.step(1)
    assert client.ask("MG 2\r", 2) == " 1.0000\r\n: 2.0000\r\n:"


def test_split_replies(server, client):
    server.fault("split")
    assert client.ask("MG 1\r") == " 1.0000\r\n:"


def test_the_nth_segment_is_refused_once(server, client):
    server.fault("refuse-pv at=3 code=32")
    assert client.ask("PVA=1,0,2\r" * 5, 5) == "::?::"
    assert client.ask("TC;MG _PVA\r", 2) == "32\r\n: 251.0000\r\n:"


def test_a_half_open_link_is_silent_but_not_closed(server, client):
    server.fault("half-open")
    client.socket.sendall(b"MG 1\r")
    client.socket.settimeout(0.1)
    with pytest.raises(TimeoutError):
        client.socket.recv(1)


def test_a_reset_link(server, connect):
    clients = connect(), connect()
    for client in clients:
        client.ask("WH\r")
    server.fault("reset handle=B")
    assert clients[1].gone()
    assert clients[0].ask("TC\r") == "123\r\n:"


def test_a_power_cycle_forgets_everything_and_refuses_for_a_while(server, connect):
    client = connect()
    client.ask("SHA;SB 1;x=1\r", 3)
    server.step(100)
    server.fault("power-cycle seconds=60")
    assert client.gone()
    with pytest.raises(ConnectionError):
        connect().socket.recv(1)
    server.fault("power-cycle")
    again = connect()
    assert again.ask("MG @OUT[1],_MOA,TIME\r") == " 0.0000 1.0000 0.0000\r\n:"
    assert again.ask("MG x\r") == "?"


def test_skew_loses_segments_of_one_axis_without_a_word(server, client):
    server.fault("skew axis=B segments=2")
    assert client.ask("PVA=1,0,2;PVB=1,0,2\r" * 4, 8) == ":" * 8
    assert client.ask("MG _PVA,_PVB\r") == " 251.0000 253.0000\r\n:"


def test_a_limit_hit(server, client):
    client.ask("SHA;JGA=1000;BGA\r", 3)
    server.step(100)
    server.fault("limit axis=A side=forward")
    server.step(100)
    assert client.ask("SCA;MG _LFA\r", 2) == "2\r\n: 0.0000\r\n:"


def test_a_position_error_switches_off_even_at_rest(server, client):
    client.ask("SHA;OEA=1;ERA=100\r", 3)
    server.fault("position-error axis=A counts=101")
    server.step(1)
    assert client.ask("SCA;MG _MOA,_TEA\r", 2) == "8\r\n: 1.0000 101.0000\r\n:"


def test_a_failed_encoder_ends_in_a_position_error(server, client):
    client.ask("SHA;OEA=1;ERA=100;JGA=10000;BGA\r", 5)
    server.step(100)
    server.fault("encoder axis=A")
    server.step(100)
    assert client.ask("SCA;MG _MOA\r", 2) == "8\r\n: 1.0000\r\n:"


def test_the_abort_input(server, client):
    client.ask("SHA;OEA=1;JGA=10000;BGA\r", 4)
    server.step(10)
    server.fault("abort-input")
    assert client.ask("SCA;MG _MOA,_BGA\r", 2) == "6\r\n: 1.0000 0.0000\r\n:"


@pytest.mark.parametrize(("setting", "outlives"), [("CN ,,,,0", False), ("CN ,,,,1", True)])
def test_the_abort_input_ends_programs_or_not(server, client, setting, outlives):
    client.ask("DL\r#A\rJP #A\r\\", 2)
    client.ask(f"{setting};XQ #A\r", 2)
    server.step(4)
    server.fault("abort-input")
    assert (float(client.ask("MG _XQ0\r").split()[0]) >= 0) == outlives


def test_the_emergency_stop(server, client):
    client.ask("SH;PVA=100,1000,100;PVA=100,0,100;BTA\r", 4)
    server.step(50)
    server.fault("e-stop")
    assert client.ask("SC;MG _MOA,_MOB,_BGA,_PVA\r", 2) == "15, 15\r\n: 1.0000 1.0000 0.0000 255.0000\r\n:"


def test_an_input(server, client):
    server.fault("input number=3 level=0")
    assert client.ask("MG @IN[3]\r") == " 0.0000\r\n:"


def test_an_analog_input(server, client):
    server.fault("analog number=2 volts=-1.25")
    assert client.ask("MG @AN[2]\r") == "-1.2500\r\n:"


def test_a_wrong_sample_time_shows_against_the_clock_alone(server, client):
    server.fault("sample-time scale=1.024")
    server.call(lambda: server.clock.step(10.0))
    server.step(0)
    assert client.ask("MG TIME,_TM\r") == " 10000.0000 1000.0000\r\n:"


def test_clear_ends_all_of_it(server, client):
    for fault in ("half-open", "split", "limit axis=A side=reverse", "encoder axis=A", "sample-time scale=2"):
        server.fault(fault)
    server.fault("clear")
    client.ask("SHA;PRA=-100;BGA\r", 3)
    server.step(1000)
    assert client.ask("TPA;MG TIME\r", 2) == "-100\r\n: 1000.0000\r\n:"


@pytest.mark.parametrize(
    "line",
    [
        "nonsense",
        "delay",
        "delay seconds=-1",
        "delay seconds=x",
        "delay seconds=1 handle=Q",
        "delay colour=red",
        "limit axis=C side=forward",
        "limit axis=A side=up",
        "sample-time scale=0",
        "skew",
        "step samples=-1",
    ],
)
def test_lines_that_are_not_understood(server, line):
    with pytest.raises(ValueError):
        server.fault(line)


def test_every_line_has_a_test():
    text = Path(__file__).read_text(encoding="utf-8")
    untested = [name for name in COMMANDS if f'"{name}' not in text]
    assert untested == []


def test_a_step_by_the_back_door(server, client):
    server.fault("step samples=77")
    assert client.ask("MG TIME\r") == " 77.0000\r\n:"
