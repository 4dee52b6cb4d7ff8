"""Real bytes over a real socket: prompts, framing, handles, time."""

from __future__ import annotations

import contextlib
import socket
import struct

import pytest
from ibfctl_simulator.galil.clock import ScaledClock
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.inprocess import EmulatorServer
from ibfctl_simulator.galil.settings import Settings


@pytest.mark.parametrize(
    ("sent", "prompts", "received"),
    [
        ("\r", 1, ":"),
        ("SHA\r", 1, ":"),
        ("SHA\r\n", 1, ":"),
        ("SHA;", 1, ":"),
        ("SHA;SHB\r", 2, "::"),
        ("TP\r", 1, "0, 0\r\n:"),
        ("TPA;XX;TPB\r", 3, "0\r\n:?0\r\n:"),
        ("bg\r", 1, "?"),
        ("x=1\n\r", 1, ":"),
        ("MG _BGA,_BGB\r", 1, " 0.0000 0.0000\r\n:"),
        ("\x12\x16\r", 1, "DMC4020 Rev 1.3a\r\n:"),
        ("SH" + " " * 100 + "\rTPA\r", 2, "?0\r\n:"),
    ],
)
def test_replies_byte_for_byte(client, sent, prompts, received):
    assert client.ask(sent, prompts) == received


def test_a_command_may_arrive_byte_by_byte(client):
    for byte in "MG TIM":
        client.socket.sendall(byte.encode())
    assert client.ask("E\r") == " 0.0000\r\n:"


def test_an_over_long_line_has_a_code_of_its_own(client):
    client.ask("S" * 81 + "\r")
    assert client.ask("TC1\r").startswith("5 ")


def test_the_error_code_is_shared_by_all_clients(connect):
    first, second = connect(), connect()
    first.ask("bg\r")
    assert second.ask("TC\r") == "1\r\n:"
    assert first.ask("TC\r") == "0\r\n:"


def test_a_profile_runs_on_the_clock_alone(server, client):
    client.ask("SHA;PVA=100,0,128;PVA=0,0,0;BTA\r", 4)
    server.step(64)
    assert client.ask("MG _RPA,_SCA,TIME\r") == " 50.0000 30.0000 64.0000\r\n:"
    server.step(64)
    assert client.ask("MG _RPA,_SCA,_BTA\r") == " 100.0000 31.0000 2.0000\r\n:"


def test_two_hundred_lines_in_one_packet_all_get_their_prompt(client):
    assert client.ask("PVA=1,0,2\r" * 200, 200) == ":" * 200
    assert client.ask("MG _PVA\r") == " 55.0000\r\n:"


def test_each_client_has_a_handle_and_a_closed_one_is_free_again(server, connect):
    clients = [connect() for _ in range(3)]
    assert [client.ask("WH\r") for client in clients] == ["IHA\r\n:", "IHB\r\n:", "IHC\r\n:"]
    clients[1].close()
    while "IHB AVAILABLE" not in clients[0].ask("TH\r"):
        pass
    assert connect().ask("WH\r") == "IHB\r\n:"


def test_the_list_of_handles_names_addresses_and_ports(client):
    lines = client.ask("TH\r").split("\r\n")
    port = client.socket.getsockname()[1]
    assert lines[0].startswith("CONTROLLER IP ADDRESS 127,0,0,1 ETHERNET ADDRESS ")
    assert lines[1] == f"IHA TCP PORT 23 TO IP ADDRESS 127,0,0,1 PORT {port}"
    assert lines[2:] == [f"IH{letter} AVAILABLE" for letter in "BCDEFGH"] + [":"]


def test_the_ninth_connection_is_reset(connect):
    clients = [connect() for _ in range(8)]
    assert clients[7].ask("WH\r") == "IHH\r\n:"
    with pytest.raises(ConnectionResetError):
        connect().socket.recv(1)
    assert clients[0].ask("WH\r") == "IHA\r\n:"


def test_closing_all_others_leaves_the_one_that_asks(connect):
    clients = [connect() for _ in range(3)]
    assert clients[2].ask("WH\r") == "IHC\r\n:"
    assert clients[2].ask("IHT=>-3\r") == ":"
    assert clients[0].gone()
    assert clients[1].gone()
    assert clients[2].ask("TC\r") == "0\r\n:"


def test_a_client_lost_by_reset_leaves_code_123(server, connect):
    lost, other = connect(), connect()
    lost.ask("WH\r")
    lost.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    lost.close()
    while "IHA TCP" in other.ask("TH\r"):
        pass
    assert other.ask("TC1\r").startswith("123 ")


def test_motion_goes_on_when_the_client_is_gone(server, connect):
    first = connect()
    first.ask("SHA;PVA=100,0,128;PVA=0,0,0;BTA\r", 4)
    first.close()
    server.step(200)
    assert connect().ask("TPA;SCA\r", 2) == "100\r\n:31\r\n:"


def test_scaled_time_runs_at_its_speed():
    with EmulatorServer(Controller(), ScaledClock(1000.0)) as server, socket.create_connection(
        ("127.0.0.1", server.port), timeout=5
    ) as client:
        samples = 0.0
        while samples < 1024:
            client.sendall(b"MG TIME\r")
            samples = float(client.recv(100).split()[0])
        assert samples < 1024 * 1000


def test_a_handle_can_be_closed_in_good_order(connect):
    asking, other = connect(), connect()
    assert other.ask("WH\r") == "IHB\r\n:"
    assert asking.ask("IHB=>-2\r") == ":"
    assert other.socket.recv(1) == b""
    assert asking.ask("MG _IHA2,_IHC2\r") == " 2.0000 0.0000\r\n:"


def test_a_client_that_never_reads_is_dropped(server, connect):
    deaf, other = connect(), connect()
    deaf.ask("WH\r")
    deaf.socket.setblocking(False)
    lines = b"MG 1,2,3,4,5,6,7,8,9\r" * 1000
    with contextlib.suppress(ConnectionError):
        while "IHA TCP" in other.ask("TH\r"):
            with contextlib.suppress(BlockingIOError):
                deaf.socket.send(lines)
    assert other.ask("MG 1\r") == " 1.0000\r\n:"


def test_a_download_without_end_fills_no_memory(server, client):
    client.ask("DL\r" + "x" * 1000, 1)
    client.socket.sendall(b"y" * 100_000 + b"NO\r" * 5000 + b"\\TC\r")
    assert client.read(2) == ":60\r\n:"


def test_a_clock_that_is_too_fast_slips_and_clients_still_get_answers():
    with (
        EmulatorServer(Controller(Settings(motor_on_at_start=True)), ScaledClock(1e9)) as server,
        socket.create_connection(("127.0.0.1", server.port), timeout=5) as client,
    ):
        client.sendall(b"JGA=1000;BGA\r")
        assert client.recv(10) == b"::"
        client.sendall(b"MG _BGA\r")
        assert client.recv(100) == b" 1.0000\r\n:"


@pytest.mark.parametrize(("go_on", "received"), [(True, ":?:"), (False, ":?")])
def test_whether_a_line_goes_on_behind_an_error_is_a_setting(serve, go_on, received):
    client = serve(continue_line_after_error=go_on)
    assert client.ask("SB 1;bad;SB 2\r", len(received)) == received
    assert client.ask("MG @OUT[1],@OUT[2]\r") == (" 1.0000 1.0000\r\n:" if go_on else " 1.0000 0.0000\r\n:")


def test_a_client_that_leaves_while_its_reply_is_due_frees_its_handle(connect):
    waiting, other = connect(), connect()
    assert waiting.ask("NO;WT 1000000\r") == ":"
    waiting.close()
    while "IHA AVAILABLE" not in other.ask("TH\r"):
        pass
    assert other.ask("WH\r") == "IHB\r\n:"


def test_a_client_that_goes_on_sending_while_its_reply_is_due_is_dropped(connect):
    waiting, other = connect(), connect()
    assert waiting.ask("NO;WT 1000000\r") == ":"
    with pytest.raises(ConnectionError):
        waiting.socket.sendall(b"TP\r" * 10_000_000)
    assert other.ask("WH\r") == "IHB\r\n:"
