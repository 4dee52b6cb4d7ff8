"""Two services never work on one data folder."""

import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from ibfctl.cli.main import run


def _files(data: Path) -> set[str]:
    """What a service keeps; its emulated controller may still be starting."""
    return {path.name for path in data.iterdir() if not path.name.startswith("emulator")}


def test_a_second_service_on_the_same_data_is_refused(
    served: httpx.Client, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "data"
    before = _files(data)
    assert run(["serve", "--simulate", "--port", "0", "--data", str(data)]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: serve: data folder {data} is in use by another service (process ")
    assert said.endswith("; end that one first, or give another --data\n")
    assert _files(data) == before
    assert served.get("/readyz").status_code == 200


def test_a_service_that_was_killed_leaves_its_data_free(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ibfctl", "serve", "--machine", "simulator", "--port", "0"]
    for _ in range(2):
        with subprocess.Popen([*command, "--data", str(tmp_path)], stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None
            assert process.stderr.readline().startswith("serving on")
            process.kill()
