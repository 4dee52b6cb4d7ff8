"""`ibfctl tolerance` as other programs and people see it."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ibfctl.cli.main import run

INTERRUPTED = 130
CLUSTER = """
import sys
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


def test_json_holds_the_distribution_and_every_cause(small_plan: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["tolerance", str(small_plan), "--draws", "20", "--seed", "3", "--workers", "2", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert set(figures) == {
        "draws",
        "seed",
        "tolerances",
        "predicted_rms_nm",
        "predicted_pv_nm",
        "rms_nm",
        "pv_nm",
        "causes",
        "dominant",
    }
    assert set(figures["rms_nm"]) == {"mean", "standard_deviation", "percentiles"}
    assert list(figures["rms_nm"]["percentiles"]) == ["p5", "p25", "p50", "p75", "p95", "p99"]
    assert figures["dominant"] in figures["causes"]
    assert run(["tolerance", str(small_plan), "--draws", "20", "--seed", "3", "--workers", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == figures


def test_people_get_two_tables(small_plan: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--draws", "4", "--workers", "1", "--servo-lag-ms", "0", "--height-noise-nm", "0"]
    assert run(["tolerance", str(small_plan), *arguments]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines if line] == ["residual", "RMS", "PV", "cause", *_causes(lines)]
    assert sorted(_causes(lines)) == ["offset", "rate", "rotation", "tif"]


def _causes(lines: list[str]) -> list[str]:
    return [line.split()[0] for line in lines if line.endswith("%")]


def test_without_the_extra_or_a_scheduler_one_line_says_so(
    small_plan: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert run(["tolerance", str(small_plan), "--dask", "tcp://127.0.0.1:9"]) == 2
    assert "ibfctl[cluster]" in capsys.readouterr().err


def test_an_interrupt_ends_all_processes(small_plan: Path) -> None:
    command = [sys.executable, "-m", "ibfctl", "tolerance", str(small_plan), "--draws", "100000"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("drawing runs")
        process.send_signal(signal.SIGINT)
        out, rest = process.communicate(timeout=60)
    assert process.returncode == INTERRUPTED
    assert out == ""
    assert rest.splitlines()[-1] == "error: interrupted"
    assert "Traceback" not in rest


@pytest.mark.slow
def test_a_cluster_of_two_workers_finds_the_same(small_plan: Path) -> None:
    def figures(*more: str) -> dict[str, object]:
        command = [sys.executable, "-m", "ibfctl", "tolerance", str(small_plan), "--draws", "50", "--json", *more]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
        found: dict[str, object] = json.loads(done.stdout)
        return found

    with subprocess.Popen(
        [sys.executable, "-c", CLUSTER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as cluster:
        assert cluster.stdout is not None
        address = cluster.stdout.readline().strip()
        assert figures("--dask", address) == figures("--workers", "1")
        cluster.communicate(timeout=60)
    refused = [sys.executable, "-m", "ibfctl", "tolerance", str(small_plan), "--dask", address]
    done = subprocess.run(refused, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"error: tolerance: no Dask scheduler answers at {address}")
