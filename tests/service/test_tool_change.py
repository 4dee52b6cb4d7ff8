"""A plan of two tools as one run of the service: the machine is free between them, and the change is confirmed."""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from ibfctl.planning.file import write_sequence
from ibfctl.service.settings import Settings
from ibfctl.service.store import Collection
from tests.support.served import PATIENCE_S, ended
from tests.support.two_tools import two_tools


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return dataclasses.replace(settings, speed=30.0)


def _until(client: httpx.Client, place: str, told: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    deadline = time.monotonic() + PATIENCE_S
    while not told(record := client.get(place).raise_for_status().json()):
        assert time.monotonic() < deadline, record
        time.sleep(0.02)
    return record


def test_between_two_tools_the_machine_is_homed_and_the_change_confirmed(
    plan_id: str, settings: Settings, client: httpx.Client
) -> None:
    sequence = two_tools()
    write_sequence(sequence, Collection(settings.data, "plans").path(plan_id, "plan.h5"))
    place = client.post("/v1/runs", json={"plan_id": plan_id}).headers["Location"]
    assert client.post(f"{place}/confirm").status_code == 409
    status = _until(client, place, lambda run: run["state"] == "tool_change")["status"]
    assert (status["tool"], status["tools"], status["gate"]) == (1, 2, "closed")
    assert client.post("/v1/runs", json={"plan_id": plan_id}).status_code == 409
    assert client.post("/v1/machine/home").status_code == 202
    act = _until(client, "/v1/machine", lambda machine: machine["act"]["state"] != "running")["act"]
    assert (act["name"], act["state"]) == ("home", "done")
    assert client.post(f"{place}/confirm").status_code == 202
    run = ended(client, place)
    assert run["state"] == "completed", run
    assert run["figures"]["as_run_rms_nm"] == pytest.approx(sequence.summary()["executed_rms_nm"], abs=0.05)
    for name in ("run.h5", "residual.npz", "residuals.png"):
        assert client.get(f"{place}/files/{name}").status_code == 200
