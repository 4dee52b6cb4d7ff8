"""From upload to as-run residual over REST alone, against the service as its own process."""

import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest

from tests.support.served import PATIENCE_S, ended
from tests.support.small_job import TIF, SmallJob

STARTS_WITH = {".h5": b"\x89HDF", ".png": b"\x89PNG", ".npz": b"PK"}


def test_from_upload_to_as_run_residual(served: httpx.Client, small_job: SmallJob) -> None:
    answer = served.post("/v1/maps", params={"format": "npz"}, content=small_job.map.read_bytes())
    assert answer.status_code == 201
    surface = answer.json()
    assert (surface["figures"]["nx"], surface["figures"]["ny"]) == (48, 32)
    influence = served.post("/v1/influences", params={"formula": TIF}).raise_for_status().json()
    assert influence["figures"]["peak_rate_nm_s"] == 4.0

    request = {"map_id": surface["id"], "influence_id": influence["id"], "pitch_mm": 1.0, "step_mm": 1.0}
    answer = served.post("/v1/plans", json=request)
    assert answer.status_code == 202
    plan = ended(served, answer.headers["Location"])
    assert plan["state"] == "done", plan
    assert plan["summary"]["certificate"]["passed"] is True

    answer = served.post("/v1/runs", json={"plan_id": plan["id"]})
    assert answer.status_code == 202
    run = ended(served, answer.headers["Location"])
    assert run["state"] == "completed", run
    assert run["status"]["executed"] == run["status"]["total"] == plan["summary"]["segments"]
    assert run["status"]["gate"] == "closed"
    assert run["figures"]["as_run_rms_nm"] == pytest.approx(plan["summary"]["executed_rms_nm"], abs=0.05)

    for record in (surface, plan, run):
        again = served.get(record["links"]["self"]).raise_for_status().json()
        assert again["id"] == record["id"]
        for name, place in again["links"].items():
            content = served.get(place).raise_for_status().content
            assert content.startswith(STARTS_WITH.get(Path(name).suffix, b"")), name
            assert len(content) > 100


def test_an_abort_ends_the_run_and_says_so(served: httpx.Client, small_job: SmallJob, tmp_path: Path) -> None:
    surface = served.post("/v1/maps", params={"format": "npz"}, content=small_job.map.read_bytes()).json()
    weak = TIF.replace("peak_nm_s=4", "peak_nm_s=0.01")  # hours of beam time: the run is surely under way
    influence = served.post("/v1/influences", params={"formula": weak}).json()
    request = {"map_id": surface["id"], "influence_id": influence["id"], "pitch_mm": 1.0, "step_mm": 1.0}
    plan = ended(served, served.post("/v1/plans", json=request).headers["Location"])
    assert plan["state"] == "done", plan
    place = served.post("/v1/runs", json={"plan_id": plan["id"]}).headers["Location"]
    busy = served.post("/v1/runs", json={"plan_id": plan["id"]})
    assert (busy.status_code, busy.json()["code"]) == (409, "conflict")
    deadline = time.monotonic() + PATIENCE_S
    while served.get(place).json()["state"] != "running" and time.monotonic() < deadline:
        time.sleep(0.02)
    assert served.get(place).json()["status"]["margin_s"] > 0
    nowhere = ["--data", str(tmp_path / "none")]  # so that the service itself must do it
    command = [sys.executable, "-m", "ibfctl", "abort", "--url", str(served.base_url), *nowhere]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert said == f"aborted  {place.rpartition('/')[2]}\n"
    run = ended(served, place)
    assert (run["state"], run["error"]["code"]) == ("aborted", "aborted")
    assert run["error"]["detail"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "nothing runs\n"
    assert served.post(f"{place}/abort").status_code == 202
