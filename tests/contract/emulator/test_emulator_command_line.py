"""`ibfctl-simulator` as its own process."""

from __future__ import annotations

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
