"""Programs, delayed replies and unasked text over the wire."""

from __future__ import annotations

import pytest


def test_a_download_may_arrive_in_one_packet_with_what_follows_it(client):
    assert client.ask("DL\r#A\rx=1;y=2\rEN\r\\\rMG 5\r", 3) == ":: 5.0000\r\n:"
    client.socket.sendall(b"UL\r")
    assert client.read() == "#A\r\nx=1;y=2\r\nEN\r\n\x1a:"


def test_a_download_may_arrive_byte_by_byte(client):
    for byte in "DL\r\n#A\r\nEN\r\n\\":
        client.socket.sendall(byte.encode())
    assert client.read(2) == "::"
    assert client.ask("\rTC\r", 1) == "0\r\n:"


def test_lines_come_back_byte_for_byte(client):
    lines = ["#AUTO", "  MG \"a b\" ' note", "", "IF (x=1);ELSE;ENDIF", "EN"]
    client.ask("DL\r" + "".join(f"{line}\r" for line in lines) + "\\", 2)
    client.socket.sendall(b"UL\r")
    assert client.read() == "".join(f"{line}\r\n" for line in lines) + "\x1a:"


def test_a_line_that_is_too_long_is_refused_and_the_old_program_stays(client):
    client.ask("DL\r#OLD\r\\", 2)
    assert client.ask("DL\r" + "x" * 81 + "\rSB 1\r\\", 2) == "?:"
    assert client.ask("TC\r") == "60\r\n:"
    assert client.ask("MG @OUT[1]\r") == " 0.0000\r\n:"
    client.socket.sendall(b"UL\r")
    assert client.read() == "#OLD\r\n\x1a:"


def test_duplicate_labels_are_refused_at_the_end(client):
    assert client.ask("DL\r#A\r#A\r\\", 2) == "?:"
    assert client.ask("TC\r") == "61\r\n:"


def test_a_live_trippoint_delays_its_prompt_and_all_that_follows(server, client):
    client.ask("SHA;PAA=1000;BGA\r", 3)
    client.socket.sendall(b"AMA;MG _BGA\r")
    client.socket.settimeout(0.05)
    with pytest.raises(TimeoutError):
        client.socket.recv(1)
    client.socket.settimeout(5)
    server.step(1000)
    assert client.read(2) == ": 0.0000\r\n:"


def test_burning_a_program_takes_its_time(server, client):
    assert client.ask("NO;BP\r") == ":"
    server.step(1500)
    client.socket.settimeout(0.05)
    with pytest.raises(TimeoutError):
        client.socket.recv(1)
    client.socket.settimeout(5)
    server.step(600)
    assert client.read() == ":"


def test_unasked_text_goes_to_one_client_marked(server, connect):
    asking, other = connect(), connect()
    asking.ask("CF I;CW 1\r", 2)
    other.ask('DL\rWT 5;MG "hello"\r\\', 2)
    other.ask("XQ\r")
    server.step(10)
    expected = bytes(byte | 0x80 for byte in b"hello\r\n")
    assert asking.socket.recv(100) == expected
    assert other.ask("TC\r") == "0\r\n:"


def test_records_are_pushed_without_a_prompt(server, client):
    client.ask("DR 100, 0\r")
    server.step(350)
    data = b""
    while len(data) < 3 * 154:
        data += client.socket.recv(4096)
    samples = [int.from_bytes(data[k * 154 + 4 : k * 154 + 6], "little") for k in range(3)]
    assert samples == [100, 200, 300]
    assert client.ask("DR 0\r") == ":"
    server.step(500)
    assert client.ask("TC\r") == "0\r\n:"


def test_reset_closes_connections_and_starts_anew(server, connect):
    client = connect()
    client.ask("SB 1\r")
    client.socket.sendall(b"RS\r")
    assert client.gone()
    assert connect().ask("MG @OUT[1]\r") == " 0.0000\r\n:"


def test_a_program_loses_no_reply_of_a_client_that_is_busy_downloading(server, connect):
    first, second = connect(), connect()
    first.socket.sendall(b"DL\r#A\r")
    assert second.ask("MG 1\r") == " 1.0000\r\n:"
    assert first.ask("EN\r\\", 2) == "::"
