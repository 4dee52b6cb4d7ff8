"""Starting the emulated controller, and finding the driver."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from support.programs import machine

from ibfctl.errors import ControllerError, InputError
from ibfctl.runs.drivers import connect
from ibfctl.runs.emulator import EmulatedController, emulated_controller


def test_an_emulated_controller_that_cannot_start_says_why(tmp_path: Path) -> None:
    with (
        pytest.raises(ControllerError, match=r"did not start: .*no-folder"),
        emulated_controller(tmp_path / "no-folder" / "trace.h5"),
    ):
        pytest.fail("it cannot have started")


def test_the_emulated_controller_ends_with_its_parent(tmp_path: Path) -> None:
    """A parent killed in the middle of a run leaves no controller behind."""
    script = (
        "import sys; from pathlib import Path; from ibfctl.runs.emulator import emulated_controller\n"
        "with emulated_controller(None) as emulated:\n"
        "    print(emulated.port, flush=True); sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        port = int(parent.stdout.readline())
        parent.kill()
    emulated = EmulatedController("127.0.0.1", port, 1.0)
    with pytest.raises(ControllerError):
        connect_again_and_again(emulated)


def connect_again_and_again(emulated: EmulatedController) -> None:
    for _ in range(1000):
        connect(emulated.in_place_of(machine())).close()


def test_the_emulated_controller_takes_the_place_of_host_and_serial_port() -> None:
    here = EmulatedController("127.0.0.1", 4711, 1.0).in_place_of(machine(serial="/dev/ttyS0"))
    assert (here.connection.host, here.connection.port, here.connection.serial) == ("127.0.0.1", 4711, None)


def test_a_driver_that_is_not_installed_is_named_with_those_that_are() -> None:
    with pytest.raises(InputError, match=r"driver 'aerotech'.*installed drivers: galil"):
        connect(machine(driver="aerotech"))
