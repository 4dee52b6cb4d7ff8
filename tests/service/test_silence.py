"""Who is told to stop and hangs: the service reaches the controller without him, and says so."""

import dataclasses
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from ibfctl.cli.main import run as command_line
from ibfctl.service.settings import Settings
from tests.support.served import PATIENCE_S, ended, serving


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return dataclasses.replace(settings, speed=1.0)


@pytest.fixture(autouse=True)
def _no_last_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ibfctl.service.fleet.LAST_S", 0.1)


def _until(client: httpx.Client, place: str, told: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    deadline = time.monotonic() + PATIENCE_S
    while not told(record := client.get(place).raise_for_status().json()):
        assert time.monotonic() < deadline, record
        time.sleep(0.02)
    return record


def _seen(client: httpx.Client) -> dict[str, Any]:
    client.post("/v1/machine/connect").raise_for_status()
    now = _until(client, "/v1/machine", lambda machine: machine["act"]["state"] != "running")
    assert now["act"]["state"] == "done", now["act"]
    seen: dict[str, Any] = now["seen"]
    return seen


@pytest.mark.parametrize(
    ("place", "state", "latched"), [("{run}/abort", "aborted", False), ("/v1/machine/estop", "estopped", True)]
)
def test_a_worker_that_hangs_is_done_without(
    plan_id: str, client: httpx.Client, place: str, state: str, latched: bool
) -> None:
    run = client.post("/v1/runs", json={"plan_id": plan_id}).headers["Location"]
    moving = _until(client, run, lambda record: record.get("status", {}).get("gate") == "open")
    os.kill(moving["status"]["worker_pid"], signal.SIGSTOP)
    assert client.post(place.format(run=run)).status_code == 202
    record = _until(client, run, lambda record: "recovered" in record)
    assert record["state"] == state
    assert "the worker did not act" in record["error"]["detail"]
    assert "the service itself closed the gate" in record["error"]["detail"]
    assert record["status"]["gate"] == "closed"
    assert record["recovered"]["executed"]
    seen = _seen(client)
    assert (seen["gate"], seen["latched"]) == ("closed", latched)
    assert not any(axis["moving"] for axis in seen["axes"].values())


def test_without_a_service_an_abort_says_what_does_not_end(
    plan_id: str, settings: Settings, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("ibfctl.cli.abort._PATIENCE_S", 0.3)
    with serving(settings) as client:
        run = client.post("/v1/runs", json={"plan_id": plan_id}).headers["Location"]
        worker = _until(client, run, lambda record: "status" in record)["status"]["worker_pid"]
    os.kill(worker, signal.SIGSTOP)
    try:
        abort = ["abort", "--data", str(settings.data), "--url", "http://127.0.0.1:1"]
        assert command_line(abort) == 5
        assert "was told and has not ended; use the machine's own stop" in capsys.readouterr().err
    finally:
        os.kill(worker, signal.SIGCONT)
    with serving(settings) as client:
        assert ended(client, run)["state"] == "aborted"


def test_an_act_on_the_machine_that_hangs_is_done_without(client: httpx.Client) -> None:
    client.post("/v1/machine/home").raise_for_status()
    _until(client, "/v1/machine", lambda machine: machine["act"]["state"] == "done")
    client.post("/v1/machine/move", json={"x_mm": 240.0}).raise_for_status()
    os.kill(_process_of_the_act(), signal.SIGSTOP)
    assert len(client.post("/v1/abort").json()["runs"]) == 1
    act = _until(client, "/v1/machine", lambda machine: machine["act"]["state"] != "running")["act"]
    assert "the service itself closed the gate" in act["error"]["detail"]
    assert not any(axis["moving"] for axis in _seen(client)["axes"].values())


def _process_of_the_act() -> int:
    """Return the process id of the act of the service in this process, as soon as it is there."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        for children in Path("/proc/self/task").glob("*/children"):
            for child in children.read_text().split():
                if b"ibfctl.service.machine_acts" in Path(f"/proc/{child}/cmdline").read_bytes():
                    return int(child)
        time.sleep(0.01)
    pytest.fail("the act has no process")
