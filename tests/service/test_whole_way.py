"""From upload to as-run residual over REST alone, against the service as its own process."""

from pathlib import Path

import httpx
import pytest

from tests.support.served import ended
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
