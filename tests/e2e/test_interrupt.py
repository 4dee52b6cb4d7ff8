"""Ctrl-C ends a verb in order: exit code 130, one line, no file, no process left behind."""

import signal
import subprocess
import sys
from pathlib import Path

from tests.support.small_job import SmallJob

INTERRUPTED = 130


def test_an_interrupted_rehearsal_leaves_nothing(small_plan: Path, tmp_path: Path) -> None:
    output = tmp_path / "run.h5"
    command = [sys.executable, "-m", "ibfctl", "simulate", str(small_plan), "--speed", "1", "-o", str(output)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        said = process.stderr.readline()
        assert said.startswith("streaming")
        process.send_signal(signal.SIGINT)
        out, rest = process.communicate(timeout=60)
    assert process.returncode == INTERRUPTED
    assert out == ""
    assert rest.splitlines()[-1] == "error: interrupted"
    assert "Traceback" not in rest
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_plan_leaves_nothing(small_job: SmallJob) -> None:
    fine = ["--pitch-mm", "0.1", "--step-mm", "0.1"]
    arguments = [*small_job.plan_arguments(small_job.folder / "plan.h5"), *fine]
    with subprocess.Popen([sys.executable, "-m", "ibfctl", *arguments], stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        process.stderr.readline()
        process.send_signal(signal.SIGINT)
        _, rest = process.communicate(timeout=60)
    assert process.returncode == INTERRUPTED
    assert rest.splitlines()[-1] == "error: interrupted"
    assert list(small_job.folder.iterdir()) == [small_job.map]
