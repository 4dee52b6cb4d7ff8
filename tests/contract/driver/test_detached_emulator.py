"""The emulated controller that outlives the service."""

import json
import os
import signal
import time
from pathlib import Path

import pytest
from support.programs import connected, machine

from ibfctl.errors import ControllerError
from ibfctl.runs.detached_emulator import DetachedEmulator, running
from ibfctl.runs.lock import MachineLock, is_held


def test_it_is_started_once_adopted_and_ended_in_order(tmp_path: Path) -> None:
    emulator = DetachedEmulator.start_or_adopt(tmp_path, speed=10)
    told = json.loads((tmp_path / "emulator.json").read_text())
    assert told["port"] == emulator.controller.port
    assert os.getsid(told["pid"]) == told["pid"]  # no signal to our session reaches it
    adopted = DetachedEmulator.start_or_adopt(tmp_path, speed=10)
    assert (emulator.adopted, adopted.adopted) == (False, True)
    assert adopted.controller == emulator.controller
    with connected(adopted.controller.in_place_of(machine())) as controller:
        assert controller.identify().axes == 2
    emulator.end()
    assert running(tmp_path) is None
    assert not (tmp_path / "emulator.json").exists()


def test_another_speed_needs_another_one_but_never_under_a_run(tmp_path: Path) -> None:
    first = DetachedEmulator.start_or_adopt(tmp_path, speed=10)
    with MachineLock(first.controller.in_place_of(machine()), "run one"):
        assert DetachedEmulator.start_or_adopt(tmp_path, speed=20).controller == first.controller
    second = DetachedEmulator.start_or_adopt(tmp_path, speed=20)
    assert second.controller.time_scale == 20
    first.end()  # reaps the process of the first, and ends what lives
    second.end()


def test_one_that_was_killed_is_replaced(tmp_path: Path) -> None:
    emulator = DetachedEmulator.start_or_adopt(tmp_path)
    os.kill(json.loads((tmp_path / "emulator.json").read_text())["pid"], signal.SIGKILL)
    deadline = time.monotonic() + 10
    while is_held(tmp_path / "emulator.lock") and time.monotonic() < deadline:
        time.sleep(0.005)
    assert running(tmp_path) is None
    emulator.end()
    again = DetachedEmulator.start_or_adopt(tmp_path)
    assert not again.adopted
    again.end()


def test_what_cannot_start_says_why(tmp_path: Path) -> None:
    with pytest.raises(ControllerError, match=r"did not start: .*axes"):
        DetachedEmulator.start_or_adopt(tmp_path, axes=99)
    assert running(tmp_path) is None
