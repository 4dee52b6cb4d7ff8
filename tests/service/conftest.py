import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from ibfctl.machine.shipped import shipped_machine
from ibfctl.service.settings import Settings
from tests.support.served import serving
from tests.support.small_job import SmallJob, write_small_job


@pytest.fixture
def small_job(tmp_path: Path) -> SmallJob:
    return write_small_job(tmp_path)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(tmp_path / "data", shipped_machine("simulator"), simulate=True, speed=100.0)


@pytest.fixture
def client(settings: Settings) -> Iterator[httpx.Client]:
    with serving(settings) as client:
        yield client


@pytest.fixture
def served(tmp_path: Path) -> Iterator[httpx.Client]:
    """The service as its own process, as an operator starts it."""
    command = [sys.executable, "-m", "ibfctl", "serve", "--simulate", "--port", "0", "--speed", "100"]
    with subprocess.Popen([*command, "--data", str(tmp_path / "data")], stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            said = process.stderr.readline()
            address = re.search(r"http://\S+:\d+", said)
            assert address, said
            with httpx.Client(base_url=address[0], timeout=30) as client:
                yield client
        finally:
            process.terminate()
    assert process.returncode in (0, -15)
