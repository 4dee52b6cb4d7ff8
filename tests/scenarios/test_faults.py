"""Whatever goes wrong on the way, the gate closes first and the run says so."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from support.fake_galil import ABORT, GATE, PROMPT, REFUSAL, STATUS, STREAM, FakeGalil
from support.programs import connected, machine, program

from ibfctl.errors import AbortedError, ControllerError, LinkError, RunError
from ibfctl.runs.drivers import connect
from ibfctl.runs.outcome import RunOutcome
from ibfctl.runs.streamer import execute

SCALE = 100
SEGMENTS = 600
TIMEOUT_S = 1.0


STAMP = "gcls=gcls+((gcls=0)*TIME)"

Fault = Callable[[FakeGalil, int, str], "bytes | None"]


@contextlib.contextmanager
def a_run_with(fault: Fault) -> Iterator[tuple[FakeGalil, Callable[[], RunOutcome]]]:
    """A connected fake with that fault, and a function that runs a program on it."""
    with FakeGalil(sample_rate_hz=1024 * SCALE) as galil:
        galil.fault = lambda handle, command: fault(galil, handle, command)
        bench = machine(port=galil.port, timeout_s=TIMEOUT_S)
        with connected(bench) as controller:
            yield (
                galil,
                lambda: execute(
                    program(SEGMENTS, 2048), bench, controller, time_scale=SCALE, poll_interval_s=0.002
                ),
            )


def began(galil: FakeGalil) -> bool:
    return (STREAM, "BT AB") in galil.log


def closes_after_begin(galil: FakeGalil) -> int:
    """Index of the first command that closes the gate after the axes began to move."""
    start = galil.log.index((STREAM, "BT AB"))
    return next(place for place, (_, command) in enumerate(galil.log) if place > start and command == "CB 1")


def assert_gate_closed_before_stop(galil: FakeGalil) -> None:
    assert galil.outputs[1] == 0
    stops = [place for place, (_, command) in enumerate(galil.log) if command in ("ST AB", "AB")]
    assert all(closes_after_begin(galil) < place for place in stops)
    if any(galil.stop_code[letter] == 30 for letter in "AB"):
        assert stops, "axes that may still move were told to stop"


def in_full_swing(galil: FakeGalil) -> bool:
    """More segments were sent than the buffer holds, so the axes move and are being fed."""
    return began(galil) and len(galil.sent(STREAM)) > 2 * 300


def is_segment(galil: FakeGalil, command: str, letter: str, number: int) -> bool:
    start = f"PV{letter}"
    return command.startswith(start) and sum(line.startswith(start) for line in galil.sent(STREAM)) == number


def test_a_refused_segment_is_named_with_the_controllers_reason() -> None:
    def refuse(galil: FakeGalil, handle: int, command: str) -> bytes | None:
        if is_segment(galil, command, "A", 300):
            galil.reason = "6 Number out of range"
            return REFUSAL
        return None

    with a_run_with(refuse) as (galil, run):
        with pytest.raises(RunError, match=r"refused segment 299 of axis A: 6 Number out of range"):
            run()
        assert_gate_closed_before_stop(galil)
        asked = [place for place, (_, command) in enumerate(galil.log) if command == "TC1"][-1]
        assert closes_after_begin(galil) < asked


def test_a_segment_refused_while_filling_opens_no_gate() -> None:
    def refuse(galil: FakeGalil, handle: int, command: str) -> bytes | None:
        return REFUSAL if is_segment(galil, command, "B", 19) else None

    with a_run_with(refuse) as (galil, run):
        with pytest.raises(ControllerError, match="segment 18 of axis B"):
            run()
        assert not began(galil)
        assert all(command != "SB 1" for _, command in galil.log)


@pytest.mark.parametrize("handle", [STREAM, STATUS])
def test_a_reset_handle_ends_the_run(handle: int) -> None:
    def reset(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if number == handle and in_full_swing(galil):
            raise ConnectionResetError
        return None

    with a_run_with(reset) as (galil, run):
        with pytest.raises(RunError, match=r"run ended after \d+ of 600"):
            run()
        assert_gate_closed_before_stop(galil)


def test_the_gate_is_closed_on_a_fresh_handle_when_all_are_lost() -> None:
    def reset_all(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if number <= ABORT and in_full_swing(galil):
            raise ConnectionResetError
        return None

    with a_run_with(reset_all) as (galil, run):
        with pytest.raises(RunError):
            run()
        assert galil.outputs[1] == 0
        assert any(handle > ABORT and command == "CB 1" for handle, command in galil.log)


@pytest.mark.parametrize(
    "garbage",
    [b"\x00\xff\x13", b"::", b"3.0000\r\n:", b"12?", b"what:", b"\r\n:", b"1 2 3 4 5 6 7\r\n:", b"NaN\r\n:"],
)
@pytest.mark.parametrize("handle", [STREAM, STATUS])
def test_garbage_ends_the_run(handle: int, garbage: bytes) -> None:
    def spoil(galil: FakeGalil, number: int, command: str) -> bytes | None:
        return garbage if number == handle and in_full_swing(galil) else None

    with a_run_with(spoil) as (galil, run):
        with pytest.raises(RunError):
            run()
        assert_gate_closed_before_stop(galil)


def test_a_stale_reply_is_not_taken_for_the_next_one() -> None:
    def stale(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if number == STATUS and in_full_swing(galil):
            return b" 9 9 9 9 30 30\r\n: 9 9 9 9 30 30\r\n:"
        return None

    with a_run_with(stale) as (galil, run):
        with pytest.raises(RunError):
            run()
        assert_gate_closed_before_stop(galil)


def test_unmarked_text_that_nobody_asked_for_ends_the_run() -> None:
    def shout(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if number == STREAM and in_full_swing(galil):
            galil.shout(STATUS, b"LIMIT SWITCH A\r\n")
        return None

    with a_run_with(shout) as (galil, run):
        with pytest.raises(RunError, match="unasked"):
            run()
        assert_gate_closed_before_stop(galil)


@pytest.mark.parametrize("handle", [STREAM, STATUS])
def test_unmarked_text_inside_a_reply_ends_the_run(handle: int) -> None:
    def shout(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if number != handle or not in_full_swing(galil):
            return None
        answer = galil.answer(command)
        return answer[:2] + b" LIMIT SWITCH A\r\n" + answer[2:]

    with a_run_with(shout) as (galil, run):
        with pytest.raises(RunError, match="LIMIT SWITCH A"):
            run()
        assert_gate_closed_before_stop(galil)


def test_a_controller_that_says_done_before_the_motion_has_ended_is_not_believed() -> None:
    def done(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if in_full_swing(galil):
            galil.stop_code.update(A=31, B=31)
        return None

    with a_run_with(done) as (galil, run):
        with pytest.raises(RunError, match=rf"run ended after \d+ of {SEGMENTS} segments: axis A stopped with code 31"):
            run()
        assert_gate_closed_before_stop(galil)


def test_marked_text_is_no_fault() -> None:
    marked = bytes(byte | 0x80 for byte in b"hello? yes: 1\r\n")

    def shout(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if is_segment(galil, command, "A", 300):
            galil.shout(STATUS, marked)
            return marked[:3] + galil.answer(command) + marked[3:]
        return None

    with a_run_with(shout) as (_, run):
        assert run().segments_executed == SEGMENTS


@pytest.mark.parametrize("handle", [STREAM, STATUS])
def test_a_controller_that_no_longer_answers_ends_the_run_in_time(handle: int) -> None:
    def silent(galil: FakeGalil, number: int, command: str) -> bytes | None:
        return b"" if number == handle and began(galil) else None

    with a_run_with(silent) as (galil, run):
        started = time.monotonic()
        with pytest.raises(RunError, match="no answer"):
            run()
        assert time.monotonic() - started < 10 * TIMEOUT_S
        assert_gate_closed_before_stop(galil)


@pytest.mark.parametrize("handle", [STREAM, STATUS])
@pytest.mark.parametrize("goes_on", [True, False])
def test_a_link_that_falls_silent_is_not_waited_for_longer_than_the_guard_would(handle: int, goes_on: bool) -> None:
    """Also where the buffer is full, so that the stream has nothing to send."""
    timeout_s, patience_s = 30.0, 0.4

    def silent(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if not goes_on:
            galil.segments_per_poll = 0
        return b"" if number == handle and began(galil) and "gbeg=TIME" in galil.sent(STREAM) else None

    with FakeGalil(sample_rate_hz=1024 * SCALE) as galil:
        galil.fault = lambda handle, command: silent(galil, handle, command)
        bench = machine(port=galil.port, timeout_s=timeout_s)
        gate = bench.beam_gate.model_copy(update={"guard_patience_s": patience_s})
        bench = bench.model_copy(update={"beam_gate": gate})
        started = time.monotonic()
        with connected(bench) as controller, pytest.raises(RunError, match=": no answer"):
            execute(program(SEGMENTS, 2048), bench, controller, time_scale=SCALE)
        assert time.monotonic() - started < timeout_s
        assert_gate_closed_before_stop(galil)


def test_where_the_guard_has_gone_the_gate_is_closed_though_the_poll_hangs() -> None:
    """`AB` of anybody else ends every program on the controller."""
    waiting: list[bytes] = []

    def ended(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if not in_full_swing(galil):
            return None
        galil.guard_line = -1
        if number == STATUS and galil.outputs[1]:
            waiting.append(galil.answer(command))
            return b""
        if number == GATE and command == "CB 1":
            galil.outputs[1] = 0
            galil.shout(STATUS, b"".join(waiting))
            waiting.clear()
        return None

    with a_run_with(ended) as (galil, run):
        with pytest.raises(RunError, match="the guard on the controller closed the gate"):
            run()
        assert_gate_closed_before_stop(galil)


def test_a_controller_that_never_answers_is_given_up_at_connect() -> None:
    with FakeGalil(fault=lambda handle, command: b"") as galil:
        started = time.monotonic()
        with pytest.raises(LinkError, match="no answer"):
            connect(machine(port=galil.port, timeout_s=TIMEOUT_S))
        assert time.monotonic() - started < 5 * TIMEOUT_S


def test_nobody_listening_is_one_clear_error() -> None:
    with FakeGalil() as galil:
        port = galil.port
    with pytest.raises(LinkError, match=f"127.0.0.1:{port} cannot be reached"):
        connect(machine(port=port))


def test_the_gate_closes_in_time_though_the_stream_hangs() -> None:
    """The sentinel must not wait for a reply that the streaming thread still has time to wait for."""
    timeout_s, moments = 2.0, {}

    def hang(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if number == STREAM and began(galil) and command.startswith("PV"):
            return b""
        if command == "BT AB" or (command == "CB 1" and began(galil)):
            moments.setdefault(command, time.monotonic())
        return None

    with FakeGalil(sample_rate_hz=1024 * SCALE) as galil:
        galil.fault = lambda handle, command: hang(galil, handle, command)
        bench = machine(port=galil.port, timeout_s=timeout_s)
        with connected(bench) as controller, pytest.raises(RunError, match="about to run empty"):
            execute(program(SEGMENTS), bench, controller, time_scale=SCALE)
    assert moments["CB 1"] - moments["BT AB"] < timeout_s


@pytest.mark.parametrize("code", [2, 3, 4, 6, 7, 8, 12, 15, 32, 99])
def test_an_unexpected_stop_code_ends_the_run(code: int) -> None:
    def stop(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if in_full_swing(galil):
            galil.stop_code["B"] = code
        return None

    with a_run_with(stop) as (galil, run):
        with pytest.raises(RunError, match=f"axis B stopped with code {code}"):
            run()
        assert_gate_closed_before_stop(galil)


@pytest.mark.parametrize("executed", [2, -3, 900, -900])
def test_counts_that_disagree_end_the_run(executed: int) -> None:
    def skew(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if is_segment(galil, command, "A", 300):
            galil.executed["B"] += executed
        return None

    with a_run_with(skew) as (galil, run):
        with pytest.raises(RunError, match="no longer execute the same"):
            run()
        assert_gate_closed_before_stop(galil)


def test_a_segment_dropped_in_silence_is_noticed() -> None:
    def drop(galil: FakeGalil, number: int, command: str) -> bytes | None:
        return PROMPT if is_segment(galil, command, "B", 300) else None

    with a_run_with(drop) as (galil, run):
        with pytest.raises(RunError):
            run()
        assert_gate_closed_before_stop(galil)


def test_a_gate_that_does_not_open_ends_the_run() -> None:
    def stuck(galil: FakeGalil, number: int, command: str) -> bytes | None:
        return PROMPT if command == "SB 1" else None

    with a_run_with(stuck) as (galil, run):
        with pytest.raises(RunError, match="gate did not open"):
            run()
        assert_gate_closed_before_stop(galil)


def test_a_refused_begin_closes_the_gate_again() -> None:
    def refuse(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if command == "BT AB":
            galil.reason = "20 Begin not valid with motor off"
            return REFUSAL
        return None

    with a_run_with(refuse) as (galil, run):
        with pytest.raises(RunError, match="20 Begin not valid"):
            run()
        assert_gate_closed_before_stop(galil)


def test_a_gate_that_cannot_be_closed_is_shouted_about_and_the_axes_are_not_stopped() -> None:
    def welded(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if command == "CB 1" and began(galil):
            return PROMPT
        if in_full_swing(galil):
            galil.stop_code["A"] = 8
        return None

    with a_run_with(welded) as (galil, run):
        with pytest.raises(RunError, match=r"gate could not be closed.*switch the beam off by hand"):
            run()
        assert all(command != "ST AB" for _, command in galil.log)


def test_an_interrupt_from_the_keyboard_closes_the_gate() -> None:
    def interrupt(progress: object) -> None:
        raise KeyboardInterrupt

    with FakeGalil(sample_rate_hz=1024 * SCALE) as galil:
        bench = machine(port=galil.port, timeout_s=TIMEOUT_S)
        with connected(bench) as controller, pytest.raises(KeyboardInterrupt):
            execute(program(SEGMENTS), bench, controller, time_scale=SCALE, on_progress=interrupt)
        assert_gate_closed_before_stop(galil)


def test_an_abort_leaves_gate_first_then_motion_in_one_packet_on_its_own_handle() -> None:
    abort = threading.Event()

    def hold(galil: FakeGalil, number: int, command: str) -> bytes | None:
        if command == "AB":
            galil.stop_code.update(A=7, B=7)
        return None

    with FakeGalil(sample_rate_hz=1024 * SCALE) as galil:
        galil.fault = lambda handle, command: hold(galil, handle, command)
        bench = machine(port=galil.port, timeout_s=TIMEOUT_S)
        with connected(bench) as controller, pytest.raises(AbortedError):
            execute(
                program(SEGMENTS, 2048), bench, controller, time_scale=SCALE, abort=abort,
                on_progress=lambda _: abort.set(),
            )  # fmt: skip
        assert galil.sent(ABORT) == ["CW 1", "CB 1", "AB", "CB 1", STAMP]
        assert_gate_closed_before_stop(galil)
