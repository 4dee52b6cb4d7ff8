"""Runs by their workers: acts, live status, events with replay, and a service that comes and goes."""

import dataclasses
import json
import os
import signal
import time
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from ibfctl.runs.control import send
from ibfctl.runs.places import run_folder
from ibfctl.service.settings import Settings
from tests.support.served import PATIENCE_S, ended, serving


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return dataclasses.replace(settings, speed=1.0)  # half a minute: a run is surely under way


def _started(client: httpx.Client, plan_id: str) -> str:
    answer = client.post("/v1/runs", json={"plan_id": plan_id})
    assert answer.status_code == 202, answer.text
    return answer.headers["Location"]


def _until(client: httpx.Client, place: str, told: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    deadline = time.monotonic() + PATIENCE_S
    while not told(record := client.get(place).raise_for_status().json()):
        assert time.monotonic() < deadline, record
        assert "error" not in record
        time.sleep(0.02)
    return record


def _moving(record: dict[str, Any]) -> bool:
    return record["state"] == "running" and record["status"].get("margin_s", 0) > 0


def test_a_run_outlives_the_service_that_started_it(settings: Settings, plan_id: str) -> None:
    with serving(settings) as client:
        place = _started(client, plan_id)
        _until(client, place, _moving)
    with serving(settings) as client:
        record = _until(client, place, _moving)
        assert client.get("/v1/info").json()["running"] == [record["id"]]
        assert client.post(f"{place}/abort").status_code == 202
        run = ended(client, place)
    assert (run["state"], run["error"]["code"]) == ("aborted", "aborted"), run["error"]["detail"]


def test_what_ended_while_no_service_ran_is_told_by_the_next(settings: Settings, plan_id: str) -> None:
    with serving(settings) as client:
        place = _started(client, plan_id)
        _until(client, place, _moving)
    send(run_folder(settings.data, place.rpartition("/")[2]), {"act": "abort"})
    with serving(settings) as client:
        assert ended(client, place)["state"] == "aborted"


def test_events_are_replayed_from_where_a_listener_was(settings: Settings, plan_id: str) -> None:
    with serving(settings) as client:
        place = _started(client, plan_id)
        run = place.rpartition("/")[2]
        seen: list[dict[str, Any]] = []
        with client.stream("GET", "/v1/events", params={"run": run, "after": 0}) as stream:
            for event in _events(stream):
                seen.append(event)
                if event["event"] == "telemetry" and event["data"].get("margin_s", 0) > 0:
                    break
        states = [event["data"]["state"] for event in seen if event["event"] == "state"]
        assert states[:3] == ["queued", "preflight", "moving_to_start"]
        assert seen[-1]["data"]["gate"] in ("open", "closed")
        ids = [int(event["id"]) for event in seen if "id" in event]
        assert ids == sorted(set(ids))

        client.post(f"{place}/abort")
        ended(client, place)
        rest = client.get("/v1/events", params={"follow": False}, headers={"Last-Event-ID": str(ids[0])})
        again = [event for event in _parsed(rest.text) if event["data"]["run"] == run]
        assert [event["data"]["state"] for event in again if event["event"] == "state"][-1] == "aborted"
        assert min(int(event["id"]) for event in again if "id" in event) > ids[0]
        acts = [event["data"] for event in _parsed(rest.text) if event["event"] == "act"]
        assert any(act["act"] == f"POST {place}/abort" and act["status"] == 202 for act in acts)


def test_acts_that_do_not_fit_the_state_are_refused(plan_id: str, client: httpx.Client) -> None:
    place = _started(client, plan_id)
    _until(client, place, _moving)
    refusal = client.post(f"{place}/resume")
    assert (refusal.status_code, refusal.json()["code"]) == (409, "conflict")
    assert client.delete(place).status_code == 409
    assert client.post(f"{place}/recover").status_code == 409
    assert client.post(f"{place}/stop").status_code == 202
    ended(client, place)
    assert client.post(f"{place}/stop").status_code == 202  # over is over
    for act in ("pause", "resume", "confirm"):
        assert client.post(f"{place}/{act}").status_code == 409


def test_a_run_is_paused_and_resumed_and_leaves_what_was_planned(plan_id: str, settings: Settings) -> None:
    with serving(dataclasses.replace(settings, speed=10.0)) as client:
        place = _started(client, plan_id)
        _until(client, place, lambda record: record.get("status", {}).get("progress", 0) > 0.2)
        assert client.post(f"{place}/pause", json={"when": "now"}).status_code == 202
        paused = _until(client, place, lambda record: record["state"] == "paused")
        assert paused["status"]["gate"] == "closed"
        assert client.post(f"{place}/resume").status_code == 202
        run = ended(client, place)
        plan = client.get(f"/v1/plans/{plan_id}").json()
    assert run["state"] == "completed", run
    assert run["figures"]["as_run_rms_nm"] == pytest.approx(plan["summary"]["executed_rms_nm"], abs=0.05)
    assert {"run.h5", "residual.npz", "residuals.png"} <= set(run["links"])


def test_a_run_whose_worker_was_killed_is_made_safe_and_resumed(plan_id: str, settings: Settings) -> None:
    with serving(dataclasses.replace(settings, speed=2.0)) as client:
        place = _started(client, plan_id)
        moving = _until(client, place, lambda record: record.get("status", {}).get("progress", 0) > 0.1)
        os.kill(moving["status"]["worker_pid"], signal.SIGKILL)
        run = ended(client, place)
        assert (run["state"], run["error"]["code"]) == ("interrupted", "interrupted")
        while "recovered" not in (run := client.get(place).json()):
            time.sleep(0.05)
        assert run["recovered"]["can_resume"], run["recovered"]
        assert run["recovered"]["executed"]
        assert (run["status"]["gate"], "ibfctl runs resume" in run["error"]["hint"]) == ("closed", True)
        again = client.post(f"{place}/recover")
        assert (again.status_code, again.json()["recovered"]) == (202, run["recovered"]), again.text
        answer = client.post(f"{place}/resume")
        assert answer.status_code == 202, answer.text
        assert answer.json()["state"] == "resuming"
        _until(client, place, lambda record: record["state"] == "running")
        client.post(f"{place}/abort")
        assert ended(client, place)["state"] == "aborted"


def test_an_interlock_is_pushed_by_its_name(settings: Settings, plan_id: str, client: httpx.Client) -> None:
    place = _started(client, plan_id)
    machine = run_folder(settings.data, place.rpartition("/")[2]) / "machine.toml"
    push = {"name": "beam_currant", "value": 1.2}
    refusal = client.post(f"{place}/interlock", json=push)
    assert (refusal.status_code, refusal.json()["hint"]) == (422, "its machine file has none")
    interlock = '[[interlocks]]\nname = "beam_current"\nsource = "pushed"\nmin = 1.0\nmax = 2.0\n'
    text = machine.read_text() + interlock
    machine.unlink()
    machine.write_text(text)
    refusal = client.post(f"{place}/interlock", json=push)
    assert (refusal.status_code, refusal.json()["hint"]) == (422, "those of its machine are beam_current")
    assert client.post(f"{place}/interlock", json={**push, "name": "beam_current"}).status_code == 202
    client.post(f"{place}/abort")
    ended(client, place)


def test_a_slow_listener_holds_nobody_up(settings: Settings, plan_id: str) -> None:
    with serving(settings) as client:
        place = _started(client, plan_id)
        _until(client, place, _moving)
        with client.stream("GET", "/v1/events") as stream:  # never read
            assert stream.status_code == 200
            first = client.get(place).json()["status"]["seq"]
            _until(client, place, lambda record: record["status"]["seq"] > first + 5)
            assert "ibfctl_event_listeners 1" in client.get("/metrics").text
        deadline = time.monotonic() + PATIENCE_S
        while "ibfctl_event_listeners 0" not in client.get("/metrics").text:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        client.post(f"{place}/abort")
        ended(client, place)


def _events(stream: httpx.Response) -> Any:
    text = ""
    for chunk in stream.iter_text():
        *frames, text = (text + chunk).split("\n\n")
        for frame in frames:
            yield from _parsed(frame)


def _parsed(text: str) -> list[dict[str, Any]]:
    events = []
    for frame in text.split("\n\n"):
        fields = dict(line.split(": ", 1) for line in frame.splitlines() if not line.startswith(":"))
        if fields:
            events.append({**fields, "data": json.loads(fields["data"])})
    return events
