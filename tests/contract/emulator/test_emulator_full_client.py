"""What a full-size third-party client asks at connect, while it streams PVT, moves, jogs and leaves."""

from __future__ import annotations

import struct

import numpy as np
import pytest

AXES = "AB"
CLIENT_PROGRAM = [
    "#AUTO",
    "tcperr=0;cmderr=0;mlock=0;XQ#THREADA,1",
    "#LOOP",
    "WT 10;JP#LOOP",
    "#THREADA",
    "WT 20",
    "IF(homeA=1);IF(_MOA=1);homeA=0;ENDIF;ENDIF",
    "JP#THREADA",
    "#LIMSWI;RE",
    "#TCPERR",
    "tcperr=tcperr+1;IHC=>-3;RE",
    "#CMDERR",
    'errcde=_TC;cmderr=cmderr+1;MG "cmderr",errcde;EN',
]


def text(client, command, prompts=1):
    """Send one line and return its reply without the prompt."""
    reply = client.ask(f"{command}\r", prompts)
    assert reply.endswith(":" * prompts), (command, reply)
    return reply[:-prompts].removesuffix("\r\n")


def number(client, expression):
    return float(text(client, f"MG {expression}"))


def accept(client, *lines):
    """Send lines of which every command must be accepted without data."""
    for line in lines:
        prompts = line.count(";") + 1
        assert client.ask(f"{line}\r", prompts) == ":" * prompts, line


def record(client, axes=2):
    """Read one data record by `QR` and its prompt."""
    length = 82 + 36 * axes
    client.socket.sendall(b"QR\r")
    data = b""
    while len(data) < length + 1:
        data += client.socket.recv(4096)
    assert data[length:] == b":"
    return data[:length]


def connect_as_the_client_does(client, other):
    assert text(client, "WH") == "IHB"
    assert text(client, "QZ").count(",") == 3
    accept(client, "DR 0", "IHT=>-3")
    assert other.gone()
    identity = text(client, "\x12\x16")
    assert identity.startswith("DMC40")
    assert int(identity[5]) == 2
    assert "ETHERNET ADDRESS" in text(client, "TH")
    assert number(client, "_BN") > 0
    assert "AMP1," in text(client, "ID")
    accept(client, *[f"HX{thread}" for thread in range(8)])
    assert [number(client, f"_BG{axis}") for axis in AXES] == [0, 0]


def set_up_as_the_client_does(client):
    assert float(text(client, "MG_CO")) == 0
    assert [int(text(client, f"MG{{Z10.0}}_AQ{axis}")) for axis in (1, 2)] == [2, 2]
    client.socket.sendall(b"UL\r")
    assert client.read() == "\r\n\x1a:"
    program = "".join(f"{line}\r" for line in CLIENT_PROGRAM)
    assert client.ask(f"DL\r{program}\\", 2) == "::"
    client.socket.sendall(b"UL\r")
    assert client.read() == "".join(f"{line}\r\n" for line in CLIENT_PROGRAM) + "\x1a:"
    accept(client, "tcperr=0", "cmderr=0", "dpon=0", "dvalues=0", "mlock=0")
    for axis in AXES:
        assert client.ask(f"MG homed{axis}\r") == "?"
        accept(client, f"homed{axis}=0", f"home{axis}=0", f"hswact{axis}=0\n", f"cinit{axis}=0")
    accept(client, "BV", "XQ 0,0")


def configure_as_the_client_does(client):
    for axis in AXES:
        accept(client, f"FL{axis}=16909320.000000;BL{axis}=-16909320.000000", f"ER{axis}=16384.000000")
        accept(client, f"OC{axis}=0,0", f"KS{axis}=1.313", f"LC{axis}=0", f"MO{axis}", f"MT{axis}=2.0")
        assert number(client, f"_MT{axis}") == 2.0
        accept(client, f"MT{axis}=1.0")
        for setting in ("YA=16", "AG=1", "AU=0", "OE=1", "BR=0", "CE=0", "LD=0", "KP=6", "KI=0.5", "KD=64"):
            name, value = setting.split("=")
            accept(client, f"{name}{axis}={value}")
            assert number(client, f"_{name}{axis}") == pytest.approx(float(value), abs=1e-4)
        assert number(client, f"_ER{axis}") == 16384
        assert float(text(client, f"MT{axis}=?")) == 1
    accept(client, "CN 1,1,-1,0,1", *[f"CB {output}" for output in range(1, 33)])
    assert (number(client, "_CN0"), number(client, "_CA"), number(client, "_TM")) == (1, 0, 1000)
    accept(client, "CF A", "CW 1")


def stream_as_the_client_does(server, client, moves):
    """Fill the buffers, begin, ask `_BTA` before every segment, end with the marker, wait for the end."""
    accept(client, *[f"PV{axis}=0,0,-1" for axis in AXES])
    time_samples = 20
    velocities = np.zeros_like(moves)
    velocities[:, :-1] = np.round((moves[:, :-1] + moves[:, 1:]) / 2 / (time_samples / 1024))

    def send(index):
        for axis, letter in enumerate(AXES):
            accept(client, f"PV{letter}={moves[axis, index]},{velocities[axis, index]},{time_samples}")

    for index in range(255):
        send(index)
    assert number(client, "_PVA") == 0
    assert [number(client, f"_MO{axis}") for axis in AXES] == [1, 1]
    assert number(client, "@OUT[-1]") == 0
    accept(client, "SHA", "SHB", "ACA=1073740800;DCA=1073740800", "ACB=1073740800;DCB=1073740800", "BT AB")
    server.step(1)
    assert record_bit(record(client), 0, 15) == 1
    sent = 255
    for index in range(255, moves.shape[1]):
        while sent - number(client, "_BTA") >= 255:
            server.step(time_samples)
        send(index)
        sent += 1
    accept(client, *[f"PV{axis}=0,0,0" for axis in AXES])
    while number(client, "_BGA"):
        server.step(1000)
    assert number(client, "_BTA") == moves.shape[1] + 1


def record_bit(data, axis, bit):
    return struct.unpack_from("<H", data, 82 + 36 * axis)[0] >> bit & 1


def test_a_full_size_client_connects_streams_moves_and_leaves(server, connect):
    other, client = connect(), connect()
    assert text(other, "WH") == "IHA"
    connect_as_the_client_does(client, other)
    set_up_as_the_client_does(client)
    server.step(1024)
    assert [number(client, f"_XQ{thread}") != -1 for thread in (0, 1)] == [True, True]
    configure_as_the_client_does(client)
    assert len(record(client)) == 82 + 2 * 36

    angle = np.linspace(0.0, 2.0 * np.pi, 600)
    corners = np.round(np.array([5000 * (1 - np.cos(angle)), 3000 * np.sin(angle)]))
    stream_as_the_client_does(server, client, np.diff(corners, axis=1).astype(int))
    assert text(client, "TP") == "0, 0"
    assert text(client, "SC") == "31, 31"

    accept(client, "PAA=400", "ACA=256000;DCA=256000;SPA=20000", "BGA")
    server.step(200)
    assert (text(client, "TPA"), text(client, "SCA")) == ("400", "1")
    accept(client, "JGB=1000", "BGB")
    server.step(1024)
    accept(client, "STB")
    server.step(200)
    assert text(client, "SCB") == "4"
    accept(client, "PAA=100000;BGA")
    server.step(100)
    accept(client, "AB1")
    assert (text(client, "SCA"), number(client, "_BGA")) == ("7", 0)

    accept(client, "HX0", "HX1", "CF A", "CW 1", "BN", "CF S", "CW 2")


def test_the_client_aborts_a_profile_and_can_start_another(server, client):
    accept(client, "SHA;SHB")
    for _ in range(2):
        accept(client, *[f"PV{axis}=0,0,-1" for axis in AXES])
        for _ in range(20):
            accept(client, "PVA=100,1000,100", "PVB=-100,-1000,100")
        accept(client, "BT AB")
        server.step(500)
        accept(client, "ST AB", "PVA=0,0,0", "PVB=0,0,0")
        server.step(1000)
        assert text(client, "SC") == "4, 4"
        assert [number(client, f"_PV{axis}") for axis in AXES] == [254, 254]


def test_a_41x3_has_no_extended_io(serve):
    client = serve(family="41x3", axes=4)
    assert client.ask("MG_CO\r") == "?"
    assert text(client, "\x12\x16")[5] == "4"
