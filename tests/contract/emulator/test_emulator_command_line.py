"""`ibfctl-simulator` as its own process."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import h5py
import pytest

COMMAND = [sys.executable, "-m", "ibfctl_simulator"]


@contextmanager
def running(*options: str, **popen) -> Iterator[tuple[subprocess.Popen[str], int]]:
    process = subprocess.Popen(
        [*COMMAND, "--port", "0", *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **popen
    )
    with process:
        try:
            words = process.stdout.readline().split()
            assert words[:2] == ["listening", "on"]
            yield process, int(words[2].rpartition(":")[2])
        finally:
            process.kill()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_finishes_the_trace_and_exits_with_0(tmp_path, number):
    path = tmp_path / "trace.h5"
    with running("--trace", str(path), "--speed", "50", "--axes", "3") as (process, port):
        with socket.create_connection(("127.0.0.1", port), timeout=5) as client:
            client.sendall(b"SH;PVC=100,0,64;PVC=0,0,0;BTC\r")
            while b"31" not in _answer(client, b"SCC\r"):
                pass
        process.send_signal(number)
        _, errors = process.communicate(timeout=10)
    assert (process.returncode, errors) == (0, "")
    with h5py.File(path) as file:
        assert file.attrs["axes"] == "ABC"
        assert file["position_counts"].shape == (64, 3)
        assert file["position_counts"][-1].tolist() == [0, 0, 100]


def test_it_ends_with_its_parent_when_told_to():
    with running("--exit-with-parent", stdin=subprocess.PIPE) as (process, _):
        process.stdin.close()
        assert process.wait(timeout=10) == 0


def test_a_port_in_use_is_one_line_and_exit_code_2():
    with running() as (_, port):
        command = [*COMMAND, "--port", str(port)]
        second = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    assert second.returncode == 2
    assert second.stdout == ""
    assert second.stderr.startswith(f"ibfctl-simulator: cannot listen on 127.0.0.1:{port}: ")
    assert len(second.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "options",
    [
        ["--trace", "/nowhere/trace.h5"],
        ["--axes", "9"],
        ["--speed", "0"],
        ["--port", "70000"],
        ["--host", "no.such.host.invalid"],
    ],
)
def test_bad_options_exit_with_2_and_no_traceback(options):
    done = subprocess.run(
        [*COMMAND, "--port", "0", *options], capture_output=True, text=True, timeout=20, check=False
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].count(":") >= 1


def _answer(client: socket.socket, command: bytes) -> bytes:
    client.sendall(command)
    return client.recv(4096)


def test_the_model_the_settings_and_the_program_are_chosen_at_start(tmp_path):
    settings = tmp_path / "controller.toml"
    settings.write_text('axes = 8\nmotor_on_at_start = true\n[servo]\nkind = "lag"\n[switches]\nforward = 5000\n')
    program = tmp_path / "guard.dmc"
    program.write_text("#AUTO;SB 7;started=1\nEN\n")
    options = ["--settings", str(settings), "--program", str(program), "--model", "41x3", "--axes", "3"]
    with running(*options) as (_, port), socket.create_connection(("127.0.0.1", port), timeout=5) as client:
        assert _answer(client, b"\x12\x16\r").startswith(b"DMC4133 ")
        while _answer(client, b"MG started\r") == b"?":
            pass
        assert _answer(client, b"MG _MOA,@OUT[7]\r") == b" 0.0000 1.0000\r\n:"


def test_the_back_door_takes_lines_and_steps_time():
    with running("--clock", "stepped", "--control-port", "0", "--fault", "delay seconds=0.01") as (process, port):
        words = process.stdout.readline().split()
        assert words[:2] == ["control", "on"]
        back_port = int(words[2].rpartition(":")[2])
        with (
            socket.create_connection(("127.0.0.1", back_port), timeout=5) as door,
            socket.create_connection(("127.0.0.1", port), timeout=5) as client,
        ):
            assert _answer(door, b"step samples=500\n") == b"ok\n"
            assert _answer(door, b"nonsense\n").startswith(b"error: unknown command")
            assert _answer(client, b"MG TIME\r") == b" 500.0000\r\n:"


@pytest.mark.parametrize(
    ("option", "content", "reason"),
    [
        ("--settings", "colour = 1", "colour: unknown key"),
        ("--settings", "axes = true", "axes: True is not"),
        ("--settings", "axes = 9", "not between 1 and 8"),
        ("--settings", "servo = 1", "servo: a table is needed"),
        ("--settings", '[servo]\nkind = "magic"', "servo.kind: 'magic'"),
        ("--settings", "axes = ", "Invalid value"),
        ("--program", "#A\n#A\n", "61 Duplicate label"),
        ("--settings", None, "No such file"),
        ("--program", None, "No such file"),
    ],
)
def test_bad_files_are_one_line_and_exit_code_2(tmp_path, option, content, reason):
    path = tmp_path / "file"
    if content is not None:
        path.write_text(content)
    command = [*COMMAND, "--port", "0", option, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert reason in done.stderr


def test_a_bad_fault_or_control_port_ends_it():
    with running() as (_, port):
        for options in (["--fault", "nonsense"], ["--control-port", str(port)]):
            command = [*COMMAND, "--port", "0", *options]
            done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
            assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)


def test_the_back_door_survives_nonsense():
    with running("--control-port", "0") as (process, _):
        back_port = int(process.stdout.readline().rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", back_port), timeout=5) as door:
            door.sendall(b"x" * 100_000)
            assert door.recv(100) == b"error: line too long\n"
        with socket.create_connection(("127.0.0.1", back_port), timeout=5) as door:
            assert _answer(door, b"clear\n") == b"ok\n"
            process.send_signal(signal.SIGTERM)
            assert process.communicate(timeout=10) == ("", "")
    assert process.returncode == 0


def test_a_closed_standard_input_is_no_trouble():
    with running("--exit-with-parent", preexec_fn=lambda: os.close(0)) as (process, _):
        process.send_signal(signal.SIGTERM)
        assert process.communicate(timeout=10) == ("", "")
