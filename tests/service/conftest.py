import contextlib
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from ibfctl.errors import RunError
from ibfctl.machine.shipped import shipped_machine
from ibfctl.runs.control import send
from ibfctl.service.settings import Settings
from ibfctl.service.store import Collection
from tests.support.served import ended, serving
from tests.support.small_job import TIF, SmallJob, write_small_job


@pytest.fixture
def small_job(tmp_path: Path) -> SmallJob:
    return write_small_job(tmp_path)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(tmp_path / "data", shipped_machine("simulator"), simulate=True, speed=100.0)


@pytest.fixture(scope="session")
def planned_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with a map, an influence function, and a plan of half a minute."""
    folder = tmp_path_factory.mktemp("planned")
    job = write_small_job(folder)
    with serving(Settings(folder / "data", job.machine)) as client:
        surface = client.post("/v1/maps", params={"format": "npz"}, content=job.map.read_bytes()).json()
        influence = client.post("/v1/influences", params={"formula": TIF}).json()
        request = {"map_id": surface["id"], "influence_id": influence["id"], "pitch_mm": 1.0, "step_mm": 1.0}
        plan = ended(client, client.post("/v1/plans", json=request).headers["Location"])
        assert plan["state"] == "done", plan
    return folder / "data"


@pytest.fixture
def plan_id(planned_data: Path, settings: Settings) -> Iterator[str]:
    """A plan in the data folder of the test; no run of it outlives a test that fails."""
    shutil.copytree(planned_data, settings.data)
    (plan,) = Collection(settings.data, "plans").ids()
    yield plan
    for pipe in settings.data.glob("runs/*/control"):
        with contextlib.suppress(RunError):
            send(pipe.parent, {"act": "abort"})


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
