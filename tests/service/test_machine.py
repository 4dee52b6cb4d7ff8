"""The machine of the service between runs."""

import time
from typing import Any

import httpx

from tests.support.served import PATIENCE_S


def _done(client: httpx.Client, act: str, **body: float) -> dict[str, Any]:
    answer = client.post(f"/v1/machine/{act}", json=body or None)
    assert answer.status_code == 202, answer.text
    deadline = time.monotonic() + PATIENCE_S
    while (now := client.get("/v1/machine").json())["act"]["state"] == "running":
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert now["act"]["name"] == act
    shown: dict[str, Any] = now
    return shown


def test_it_is_looked_at_homed_and_moved_with_the_gate_closed(client: httpx.Client) -> None:
    assert "seen" not in client.get("/v1/machine").json()
    seen = _done(client, "connect")["seen"]
    assert seen["model"].startswith("DMC")
    assert abs(seen["sample_period_s"] * 1024 - 1) < 1e-3
    assert _done(client, "home")["act"]["state"] == "done"
    seen = _done(client, "move", x_mm=3.0, y_mm=-2.0)["seen"]
    assert {axis["coordinate"]: axis["position_mm"] for axis in seen["axes"].values()} == {"x": 3.0, "y": -2.0}
    seen = _done(client, "move", x_mm=0.5)["seen"]
    assert {axis["coordinate"]: axis["position_mm"] for axis in seen["axes"].values()} == {"x": 0.5, "y": -2.0}
    assert (seen["gate"], seen["latched"]) == ("closed", False)
    now = _done(client, "gate-test")
    assert (now["act"]["state"], now["seen"]["gate"]) == ("done", "closed"), now["act"]["error"]


def test_what_cannot_be_is_refused(client: httpx.Client) -> None:
    for nowhere in ({}, {"x_mm": False}, {"y_mm": "0"}):
        assert client.post("/v1/machine/move", json=nowhere).status_code == 422
    beyond = _done(client, "move", x_mm=1e4)["act"]
    assert (beyond["state"], beyond["error"]["code"]) == ("failed", "limits")


def test_an_act_under_way_is_aborted_and_holds_others_off(plan_id: str, client: httpx.Client) -> None:
    _done(client, "home")
    client.post("/v1/machine/move", json={"x_mm": 240.0})
    for place, body in (("machine/home", None), ("runs", {"plan_id": plan_id})):
        refusal = client.post(f"/v1/{place}", json=body)
        assert (refusal.status_code, refusal.json()["code"]) == (409, "conflict")
    assert len(client.post("/v1/abort").json()["runs"]) == 1
    deadline = time.monotonic() + PATIENCE_S
    while (act := client.get("/v1/machine").json()["act"])["state"] == "running":
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert (act["state"], act["error"]["code"]) == ("failed", "aborted"), act["error"]


def test_after_an_emergency_stop_nothing_moves(client: httpx.Client) -> None:
    assert _done(client, "estop")["seen"]["latched"] is True
    refused = _done(client, "move", x_mm=1.0)["act"]
    assert "emergency stop is latched" in refused["error"]["detail"]
