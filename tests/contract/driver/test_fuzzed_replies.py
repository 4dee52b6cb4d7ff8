"""A hostile controller can neither hang the driver, nor crash it, nor make it report success."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ibfctl_drivers.galil.link import Link, RejectedError
from ibfctl_drivers.galil.transport import Transport
from support.fake_galil import GATE, REFUSAL, FakeGalil
from support.programs import connected, machine, program

from ibfctl.errors import IbfctlError
from ibfctl.runs.streamer import execute

TIMEOUT_S = 0.05
SCALE = 100

noise = st.lists(
    st.sampled_from([b":", b"?", b"\r\n", b" 1.0000", b"0", b"-1", b"\xff\x80", b"\x00", b"\x1a:", b"NaN", b" 255 255"])
    | st.binary(max_size=6),
    max_size=8,
).map(b"".join)


class NoisyTransport:
    """Answers every send with the next noise, in pieces, and then keeps silent; time does not pass."""

    def __init__(self, replies: list[bytes]) -> None:
        self._replies = iter(replies)
        self._pieces: list[bytes] = []
        self.closed = False

    def send(self, data: bytes, timeout_s: float) -> None:
        reply = next(self._replies, b"")
        self._pieces += [reply[start : start + 3] for start in range(0, len(reply), 3)]

    def receive(self, timeout_s: float) -> bytes:
        if not self._pieces:
            raise TimeoutError("no answer")
        return self._pieces.pop(0)

    def waiting(self) -> bytes:
        data, self._pieces = b"".join(self._pieces), []
        return data

    def close(self) -> None:
        self.closed = True


def noisy_link(replies: list[bytes]) -> tuple[Link, NoisyTransport]:
    transport = NoisyTransport(replies)
    checked: Transport = transport
    return Link(checked, "fuzzed", TIMEOUT_S), transport


@given(st.lists(noise, max_size=6))
def test_requests_answer_text_or_end_in_our_errors(replies: list[bytes]) -> None:
    link, transport = noisy_link(replies)
    for _ in range(4):
        try:
            text = link.ask("MG _BTA,_BTB")
        except RejectedError:
            assert link.is_open
        except IbfctlError:
            assert transport.closed
            assert not link.is_open
        else:
            assert ":" not in text
            assert "?" not in text
            assert text.isascii()


@given(noise)
def test_a_batch_succeeds_on_its_prompts_and_on_nothing_else(reply: bytes) -> None:
    link, _ = noisy_link([reply, b"1\r\n:"])
    plain = bytes(byte for byte in reply if byte < 0x80)
    if plain == b":::":
        link.pipeline([b"PVA=1,0,2\r"] * 3)
        assert link.ask("MG _BTA") == "1"
        return
    with pytest.raises(IbfctlError):
        succeed_twice(link)


def succeed_twice(link: Link) -> None:
    """What comes too late for the batch must be noticed by the next question."""
    link.pipeline([b"PVA=1,0,2\r"] * 3)
    link.ask("MG _BTA")


@given(st.lists(noise, max_size=4))
def test_a_program_reads_back_or_ends_in_our_errors(replies: list[bytes]) -> None:
    link, transport = noisy_link(replies)
    try:
        lines = link.upload()
    except IbfctlError:
        assert transport.closed
    else:
        assert all(line.isascii() and line.strip() for line in lines)


def run_against(fault: Callable[[FakeGalil, int, str], bytes | None]) -> bool:
    """Whether a run claims success against a fake with that fault."""
    with FakeGalil(sample_rate_hz=1024 * SCALE) as galil:
        galil.fault = lambda handle, command: fault(galil, handle, command)
        bench = machine(port=galil.port, timeout_s=TIMEOUT_S)
        try:
            with connected(bench) as controller:
                execute(program(300, 2048), bench, controller, time_scale=SCALE, poll_interval_s=0.002)
        except IbfctlError:
            return False
        assert galil.outputs[1] == 0, "success with the gate open"
        return True


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(reply=noise, place=st.integers(0, 900))
def test_no_reply_at_any_place_makes_a_run_hang_or_lie(reply: bytes, place: int) -> None:
    answered: list[bytes] = []

    def spoil(galil: FakeGalil, handle: int, command: str) -> bytes | None:
        if len(galil.log) != place + 1:
            return None
        if handle != GATE:  # closing is tried again, and what reads back decides
            answered.append(galil.answer(command))
        return reply

    started = time.monotonic()
    succeeded = run_against(spoil)
    assert time.monotonic() - started < 20
    if succeeded and answered:
        plain = bytes(byte for byte in reply if byte < 0x80)
        assert (plain == b":") == (answered[0] == b":")
        assert plain.endswith(b":") or plain == answered[0] == REFUSAL
