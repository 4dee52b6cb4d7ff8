"""What all resources have in common: pages, keys against repetition, deletion, and who may ask."""

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest

from ibfctl.service.settings import Settings
from tests.support.served import ended, serving
from tests.support.small_job import TIF, SmallJob


def _formula(client: httpx.Client, **headers: str) -> dict[str, Any]:
    answer = client.post("/v1/influences", params={"formula": TIF}, headers=headers)
    record: dict[str, Any] = answer.raise_for_status().json()
    return record


def _map(client: httpx.Client, job: SmallJob, **headers: str) -> dict[str, Any]:
    content = job.map.read_bytes()
    answer = client.post("/v1/maps", params={"format": "npz"}, content=content, headers=headers)
    record: dict[str, Any] = answer.raise_for_status().json()
    return record


def test_lists_come_in_pages_oldest_first(client: httpx.Client) -> None:
    ids = []
    for _ in range(3):
        ids.append(_formula(client)["id"])
        time.sleep(0.002)  # ids are ordered by the millisecond
    first = client.get("/v1/influences", params={"limit": 2}).json()
    assert [item["id"] for item in first["items"]] == ids[:2]
    second = client.get(first["next"]).json()
    assert [item["id"] for item in second["items"]] == ids[2:]
    assert "next" not in second


def test_a_repeated_request_with_a_key_makes_nothing_new(client: httpx.Client, small_job: SmallJob) -> None:
    key = {"Idempotency-Key": "one"}
    with ThreadPoolExecutor() as panels:  # at once, as of a client that has lost patience
        maps = [panels.submit(_map, client, small_job, **key) for _ in range(2)]
        formulas = [panels.submit(_formula, client, **key) for _ in range(2)]
    (surface, again), (influence, same) = ([asked.result() for asked in pair] for pair in (maps, formulas))
    assert (again, same) == (surface, influence)
    assert _map(client, small_job, **key) == surface
    assert _formula(client, **key) == influence
    job = {"map_id": surface["id"], "influence_id": influence["id"], "pitch_mm": 1.0, "step_mm": 1.0}
    places = {client.post("/v1/plans", json=job, headers=key).headers["Location"] for _ in range(2)}
    assert len(places) == 1
    other = client.post("/v1/plans", json={**job, "pitch_mm": 2.0}, headers=key)
    assert (other.status_code, other.json()["code"]) == (409, "conflict")
    assert ended(client, places.pop())["state"] == "done"
    for kind in ("maps", "influences", "plans"):
        assert len(client.get(f"/v1/{kind}").json()["items"]) == 1


def test_what_is_referred_to_is_not_deleted(plan_id: str, client: httpx.Client) -> None:
    plan = client.get(f"/v1/plans/{plan_id}").json()
    surface, influence = (client.get(f"/v1/{kind}").json()["items"][0] for kind in ("maps", "influences"))
    run = ended(client, client.post("/v1/runs", json={"plan_id": plan_id}).headers["Location"])
    for record in (surface, influence, plan):
        refusal = client.delete(record["links"]["self"])
        assert (refusal.status_code, refusal.json()["code"]) == (409, "conflict")
    for record in (run, plan, surface, influence):
        place = record["links"]["self"]
        while (answer := client.delete(place)).status_code == 409:  # the worker of the run still writes
            time.sleep(0.05)
        assert answer.status_code == 204
        assert client.get(place).status_code == 404


def test_a_plan_is_cancelled_at_once(client: httpx.Client, small_job: SmallJob) -> None:
    surface, influence = _map(client, small_job), _formula(client)
    job = {"map_id": surface["id"], "influence_id": influence["id"], "pitch_mm": 0.1, "step_mm": 0.1}
    place = client.post("/v1/plans", json=job).headers["Location"]
    while client.get(place).json().get("progress", {}).get("stage") != "solving dwell times":
        time.sleep(0.01)
    assert client.delete(place).status_code == 409
    assert client.post(f"{place}/cancel").status_code == 202
    plan = ended(client, place)
    assert (plan["state"], plan["error"]["code"]) == ("failed", "cancelled")


@pytest.mark.parametrize(
    "headers",
    [{"Host": "example.org"}, {"Origin": "https://example.org"}, {"Origin": "null"}, {"Host": "[::1"}],
)
def test_strangers_are_refused(client: httpx.Client, headers: dict[str, str]) -> None:
    answer = client.get("/v1/info", headers=headers)
    assert (answer.status_code, answer.json()["code"]) == (403, "foreign_origin")


def test_this_computer_may_ask(client: httpx.Client) -> None:
    for headers in ({"Host": "localhost:8000"}, {"Host": "[::1]:80"}, {"Origin": "http://127.0.0.1:9"}):
        assert client.get("/healthz", headers=headers).json() == {"status": "ok"}
    info = client.get("/v1/info").json()
    assert (info["machine"], info["simulated"], info["running"]) == ("simulator", True, [])


def test_a_service_that_ends_cancels_its_plans(settings: Settings, small_job: SmallJob) -> None:
    with serving(settings) as client:
        surface, influence = _map(client, small_job), _formula(client)
        job = {"map_id": surface["id"], "influence_id": influence["id"], "pitch_mm": 0.1, "step_mm": 0.1}
        place = client.post("/v1/plans", json=job).headers["Location"]
        while "progress" not in client.get(place).json():
            time.sleep(0.01)
    with serving(settings) as client:
        plan = client.get(place).json()
    assert (plan["state"], plan["error"]["code"]) == ("failed", "interrupted")
