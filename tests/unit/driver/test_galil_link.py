from __future__ import annotations

import logging
from collections.abc import Callable

import pytest
from ibfctl_drivers.galil.link import MAX_BYTES_IN_FLIGHT, Link, RejectedError

from ibfctl.errors import LinkError


class ScriptedTransport:
    """Answers each command line by what `answer` says; silence is a timeout."""

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        self.answer = answer
        self.sent: list[bytes] = []
        self.pending = b""
        self.closed = False
        self.most_in_flight = 0

    def send(self, data: bytes, timeout_s: float) -> None:
        self.most_in_flight = max(self.most_in_flight, len(data))
        for line in data.split(b"\r")[:-1]:
            self.sent.append(line)
            self.pending += self.answer(line)

    def receive(self, timeout_s: float) -> bytes:
        if not self.pending:
            raise TimeoutError("no answer")
        return self.waiting()

    def waiting(self) -> bytes:
        data, self.pending = self.pending, b""
        return data

    def close(self) -> None:
        self.closed = True


def link_to(*answers: bytes) -> tuple[Link, ScriptedTransport]:
    script = iter(answers)
    transport = ScriptedTransport(lambda line: next(script, b""))
    return Link(transport, "test", 1.0), transport


def test_an_answer_without_data_is_the_bare_prompt() -> None:
    link, transport = link_to(b":")
    assert link.tell("SH AB") is None
    assert transport.sent == [b"SH AB"]


def test_an_answer_with_data_loses_its_line_end_and_leading_blank() -> None:
    link, _ = link_to(b" 1.0000 2.0000\r\n:")
    assert link.ask("MG _BTA,_BTB") == "1.0000 2.0000"


def test_a_refusal_asks_for_the_reason_and_names_the_command() -> None:
    link, transport = link_to(b"?", b"20 Begin not valid with motor off\r\n:")
    with pytest.raises(RejectedError, match=r"refused 'BG A': 20 Begin not valid with motor off"):
        link.tell("BG A")
    assert transport.sent == [b"BG A", b"TC1"]
    assert link.is_open


@pytest.mark.parametrize(
    "answer",
    [
        b"12.0000:",  # no line end
        b"12.0000\n:",  # half a line end
        b"text?",  # a refusal carries no text
        b"\x00:",  # no printable character
        b"::",  # one prompt too many
        b":?",
        b"1\r\n:2",
        b"\r\n\x1a:",
    ],
)
def test_garbage_closes_the_link_for_good(answer: bytes) -> None:
    link, transport = link_to(answer, b":")
    with pytest.raises(LinkError):
        link.ask("TP")
    assert transport.closed
    with pytest.raises(LinkError, match="closed because"):
        link.ask("TP")
    assert len(transport.sent) == 1


def test_an_answer_with_data_where_none_belongs_closes_the_link() -> None:
    link, transport = link_to(b"1.0000\r\n:")
    with pytest.raises(LinkError, match="is no answer to 'SH AB'"):
        link.tell("SH AB")
    assert transport.closed


def test_an_answer_without_the_data_asked_for_closes_the_link() -> None:
    link, transport = link_to(b":")
    with pytest.raises(LinkError, match="is no answer to 'MG _BTA'"):
        link.ask("MG _BTA")
    assert transport.closed


def test_silence_closes_the_link_for_good() -> None:
    link, transport = link_to(b"")
    with pytest.raises(LinkError, match="no answer"):
        link.ask("TP")
    assert transport.closed
    assert not link.is_open


def test_a_late_reply_is_never_taken_for_the_answer_to_the_next_command() -> None:
    link, transport = link_to(b":", b"5.0000\r\n:")
    link.tell("SH A")
    transport.pending = b"3.0000\r\n:"
    with pytest.raises(LinkError, match="unasked"):
        link.ask("MG _BTA")
    assert transport.sent == [b"SH A"]


def test_a_reply_without_end_is_given_up() -> None:
    link, _ = link_to(b"x" * 70_000)
    with pytest.raises(LinkError, match="does not end"):
        link.ask("LS")


def test_marked_text_is_logged_and_never_parsed(caplog: pytest.LogCaptureFixture) -> None:
    marked = bytes(byte | 0x80 for byte in b"? trouble: 7\r\n")
    link, _ = link_to(b" 1" + marked + b".0000\r\n:")
    with caplog.at_level(logging.WARNING):
        assert link.ask("MG _BTA") == "1.0000"
    assert "? trouble: 7" in caplog.text


def test_a_flood_of_marked_text_does_not_hold_a_call_beyond_its_time() -> None:
    transport = ScriptedTransport(lambda line: b"")
    transport.receive = lambda timeout_s: b"\xb1"  # type: ignore[method-assign]
    link = Link(transport, "test", 0.02)
    with pytest.raises(LinkError, match="no answer within"):
        link.ask("TP")


def test_a_batch_keeps_few_bytes_in_flight_and_checks_every_prompt() -> None:
    lines = [b"PVA=%d,100,64\r" % number for number in range(500)]
    transport = ScriptedTransport(lambda line: b":")
    Link(transport, "test", 1.0).pipeline(lines)
    assert [line + b"\r" for line in transport.sent] == lines
    assert transport.most_in_flight <= MAX_BYTES_IN_FLIGHT


def test_a_refusal_in_a_batch_names_its_line_and_leaves_the_link_in_step() -> None:
    transport = ScriptedTransport(lambda line: b"?" if line == b"PVA=7,0,2" else b":")
    link = Link(transport, "test", 1.0)
    with pytest.raises(RejectedError) as refusal:
        link.pipeline([b"PVA=%d,0,2\r" % number for number in range(200)])
    assert refusal.value.index == 7
    assert len(transport.sent) < 60
    transport.answer = lambda line: b"6 Number out of range\r\n:"
    assert link.ask("TC1") == "6 Number out of range"


@pytest.mark.parametrize("answer", [b"::", b"x", b":x", b" 1\r\n:", b"\x07"])
def test_anything_but_prompts_in_a_batch_closes_the_link(answer: bytes) -> None:
    link, transport = link_to(answer)
    with pytest.raises(LinkError):
        link.pipeline([b"PVA=1,0,2\r"])
    assert transport.closed


def test_a_prompt_after_the_last_one_owed_closes_the_link() -> None:
    link, transport = link_to(b"?:", b"6\r\n:")
    with pytest.raises(RejectedError):
        link.pipeline([b"PVA=1,0,2\r"])
    with pytest.raises(LinkError, match="unasked"):
        link.ask("TC1")
    assert transport.closed


def test_a_batch_that_is_not_answered_closes_the_link() -> None:
    link, transport = link_to(b":", b"")
    with pytest.raises(LinkError, match="no answer"):
        link.pipeline([b"PVA=1,0,2\r", b"PVA=1,0,2\r"])
    assert transport.closed
