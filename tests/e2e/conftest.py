from pathlib import Path

import pytest

from ibfctl.cli.main import run
from tests.support.small_job import SmallJob, write_small_job


@pytest.fixture
def small_job(tmp_path: Path) -> SmallJob:
    return write_small_job(tmp_path)


@pytest.fixture(scope="session")
def small_plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    job = write_small_job(tmp_path_factory.mktemp("job"))
    path = job.folder / "plan.h5"
    assert run(job.plan_arguments(path)) == 0
    return path
