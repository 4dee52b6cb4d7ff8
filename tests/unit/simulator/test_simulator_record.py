"""The data record, byte by byte."""

from __future__ import annotations

import struct

import pytest


def record(console, axes=2):
    reply = console("QR")
    data = reply.encode("latin-1")
    assert data[-1:] == b":"
    assert len(data) == 82 + 36 * axes + 1
    return data[:-1]


@pytest.mark.parametrize("axes", [1, 2, 8])
def test_header_and_length(make_console, axes):
    data = record(make_console(axes=axes), axes)
    assert data[0] & 7 == 7
    assert data[1] == (1 << axes) - 1
    assert struct.unpack_from("<H", data, 2)[0] == 82 + 36 * axes


def test_general_block(console):
    console.good("SB 1", "SB 10", "SB 80")
    console.controller.advance(70_000)
    console("bg")
    console.good("CM A", "DT -1", "CD 1=1")
    data = record(console)
    assert struct.unpack_from("<H", data, 4)[0] == 70_000 % 65_536
    assert data[6:16] == b"\xff" * 10
    assert data[16:26] == bytes([1, 2, 0, 0, 0, 0, 0, 0, 0, 0x80])
    assert data[42:50] == bytes(8)
    assert data[50] == 1
    assert struct.unpack_from("<IH", data, 56) == (0, 510)


def test_axis_block(console):
    console.good("DP 0,-1000", "DEB=77", "ZAB=-5", "JGB=-4096", "ACB=1024000", "OEB=1", "BGB")
    console.controller.advance(1024)
    block = record(console)[82 + 36 :]
    status, switches, stop_code, rp, tp, te, td, velocity = struct.unpack_from("<HBBiiiii", block)
    assert status >> 15 == 1
    assert status >> 7 & 1 == 1
    assert status >> 5 & 1 == 1
    assert status & 0b11 == 0b10
    assert switches & 0b1100 == 0b1100
    assert stop_code == 0
    assert rp == tp == console.state.axes[1].encoder_counts
    assert (te, td) == (0, 77)
    assert velocity == -4096 * 64
    assert struct.unpack_from("<i", block, 32)[0] == -5


def bits(console):
    word = struct.unpack_from("<H", record(console), 82)[0]
    return {bit for bit in range(16) if word >> bit & 1}


def test_status_bits_of_the_modes(console):
    assert bits(console) == set()
    console.good("SPA=20000", "ACA=102400", "DCA=102400", "PAA=20000", "BGA")
    console.controller.advance(50)
    assert bits(console) == {15, 14, 13}
    console.controller.advance(300)
    assert bits(console) == {15, 14, 13, 5}
    console.controller.advance(750)
    assert bits(console) == {15, 14, 13, 3}
    console.controller.advance(400)
    assert bits(console) == set()
    console.good("PVA=100,0,100", "BTA")
    console.controller.advance(10)
    assert bits(console) == {15}
    console.controller.advance(200)
    console.good("JGA=-20000", "BGA")
    console.controller.advance(400)
    console.good("STA")
    console.controller.advance(1)
    assert {15, 7, 4} <= bits(console)
    console.good("AB1", "MOA")
    assert bits(console) == {0}
    console.good("SHA", "CM A", "CDA=10=8")
    console.controller.advance(1)
    assert bits(console) == {15, 6}


def test_layout_and_switch_answers(console):
    assert console("QZ") == "2, 52, 26, 36\r\n:"
    assert console("TSA") == "14\r\n:"
    assert console("TB") == "0\r\n:"
