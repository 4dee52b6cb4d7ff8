"""A plan of two tools, and its run: the machine is free between them, and the change is confirmed."""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from ibfctl.service.settings import Settings
from tests.support.served import PATIENCE_S, ended
from tests.support.small_job import SmallJob


def _until(client: httpx.Client, place: str, told: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    deadline = time.monotonic() + PATIENCE_S
    while not told(record := client.get(place).raise_for_status().json()):
        assert time.monotonic() < deadline, record
        time.sleep(0.02)
    return record


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return dataclasses.replace(settings, speed=30.0)


def _planned(client: httpx.Client, job: SmallJob) -> dict[str, Any]:
    surface = client.post("/v1/maps", params={"format": "npz"}, content=job.map.read_bytes()).json()
    tools = []
    for fwhm_mm, pitch_mm in ((1.6, 0.8), (3.0, 1.5)):
        formula = f"gaussian:fwhm_mm={fwhm_mm},peak_nm_s=12,radius_mm={1.25 * fwhm_mm}"
        influence = client.post("/v1/influences", params={"formula": formula}).json()
        tools.append({"influence_id": influence["id"], "pitch_mm": pitch_mm})
    request = {"map_id": surface["id"], "tools": tools, "tool_change_s": 60.0, "loop": False}
    return ended(client, client.post("/v1/plans", json=request).headers["Location"])


def test_two_tools_are_planned_and_changed_in_one_run(client: httpx.Client, small_job: SmallJob) -> None:
    plan = _planned(client, small_job)
    assert plan["state"] == "done", plan
    wide, narrow = plan["summary"]["tools"]
    assert (wide["pitch_mm"], narrow["pitch_mm"]) == (1.5, 0.8)
    assert plan["summary"]["total_time_s"] == pytest.approx(wide["total_time_s"] + narrow["total_time_s"] + 60.0)
    assert plan["summary"]["executed_rms_nm"] == pytest.approx(narrow["executed_rms_nm"], rel=1e-6)
    links = set(plan["links"])
    assert {"plan.h5", "residual.npz", "plan.tool1.pvt.dmc", "plan.tool2.pvt.csv", "velocities.tool2.png"} < links
    for name in links - {"self"}:
        assert client.get(plan["links"][name]).status_code == 200, name
    segments = [client.get(plan["links"][f"plan.tool{tool}.pvt.csv"]).text.count("\n") - 1 for tool in (1, 2)]
    assert segments == [wide["segments"], narrow["segments"]]
    assert client.get(f"{plan['links']['self']}/files/plan.tool3.h5").status_code == 404
    influence = plan["request"]["tools"][0]["influence_id"]
    assert client.delete(f"/v1/influences/{influence}").json()["detail"].endswith(f"is used by plans/{plan['id']}")

    place = client.post("/v1/runs", json={"plan_id": plan["id"]}).headers["Location"]
    assert client.post(f"{place}/confirm").status_code == 409
    status = _until(client, place, lambda run: run["state"] == "tool_change")["status"]
    assert (status["tool"], status["tools"], status["gate"]) == (1, 2, "closed")
    assert client.post("/v1/runs", json={"plan_id": plan["id"]}).status_code == 409
    assert client.post("/v1/machine/home").status_code == 202
    act = _until(client, "/v1/machine", lambda machine: machine["act"]["state"] != "running")["act"]
    assert (act["name"], act["state"]) == ("home", "done")
    assert client.post(f"{place}/confirm").status_code == 202
    run = ended(client, place)
    assert run["state"] == "completed", run
    assert run["figures"]["as_run_rms_nm"] == pytest.approx(plan["summary"]["executed_rms_nm"], abs=0.05)
    links = set(run["links"]) - {"self"}
    assert links == {"run.h5", "run.tool1.h5", "run.tool2.h5", "residual.npz", "residuals.png"}
    for name in links:
        assert client.get(f"{place}/files/{name}").status_code == 200
    assert client.get(f"{place}/files/plan.h5").status_code == 404
