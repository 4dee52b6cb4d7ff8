"""The nouns of the command line, against a service."""

import dataclasses
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from ibfctl.cli import watch
from ibfctl.cli.main import run
from ibfctl.client import Client
from ibfctl.service.keys import KeyRing, Role
from ibfctl.service.settings import Settings
from tests.support.served import PATIENCE_S
from tests.support.small_job import TIF, SmallJob

Say = Callable[..., Any]


@pytest.fixture
def say(client: httpx.Client, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Say:
    """Run a command against the service; return what it prints as JSON."""
    monkeypatch.setenv("IBFCTL_URL", str(client.base_url))

    def said(*arguments: str, code: int = 0) -> Any:
        assert run([*arguments, "--json"]) == code, capsys.readouterr().err
        out = capsys.readouterr().out
        return json.loads(out) if out else None

    return said


def test_from_a_map_to_a_run_that_is_over(
    say: Say, small_job: SmallJob, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    surface = say("maps", "add", str(small_job.map))
    influence = say("influences", "add", TIF)
    machine = say("machines", "add", str(small_job.machine))
    steps = ("--set", "pitch_mm=1", "--set", "step_mm=1", "--set", "path=raster", "--machine", machine["id"])
    plan = say("plans", "create", surface["id"], influence["id"], *steps)
    assert (plan["state"], plan["request"]["pitch_mm"], plan["request"]["machine_id"]) == ("done", 1.0, machine["id"])
    assert plan == say("plans", "show", plan["id"])

    written = tmp_path / "job.pvt.dmc"
    say("plans", "export", plan["id"], "--format", "pvt.dmc", "-o", str(written))
    assert written.stat().st_size > 100
    say("maps", "show", surface["id"], "--preview", str(tmp_path / "map.png"))
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")

    made = say("runs", "start", plan["id"], "--operator", "somebody")
    assert (made["state"], made["operator"]) == ("completed", "somebody")
    assert say("runs", "report", made["id"], "--out", str(tmp_path / "report")) == say("runs", "show", made["id"])
    capsys.readouterr()
    assert run(["events", "--after", "0", "--no-follow", "--run", made["id"], "--json"]) == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    states = [event["data"]["state"] for event in events if event["event"] == "state"]
    assert (states[0], states[-1]) == ("queued", "completed")
    assert [record["id"] for record in say("runs", "list")["items"]] == [made["id"]]
    say("maps", "delete", surface["id"], code=9)
    for noun, record in (("runs", made), ("plans", plan), ("machines", machine), ("influences", influence)):
        say(noun, "delete", record["id"])
        assert say(noun, "list")["items"] == []


def test_a_plan_of_several_tools_is_asked_for(
    say: Say, small_job: SmallJob, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {"maps": str(small_job.map), "influences": TIF, "machines": str(small_job.machine)}
    surface, influence, machine = (say(noun, "add", file)["id"] for noun, file in files.items())
    tools = ("--tool", f"{influence}:machine={machine},pitch-mm=1.5,path=maze", "--tool", influence)
    more = ("--method", "sto", "--tool-change-s", "30", "--set", "loop=false", "--set", "pitch_mm=1")
    plan = say("plans", "create", surface, *tools, *more)
    given = {name: value for name, value in plan["request"]["tools"][0].items() if value is not None}
    assert given == {"influence_id": influence, "machine_id": machine, "pitch_mm": 1.5, "path": "maze"}
    assert (plan["state"], plan["summary"]["method"], plan["summary"]["tool_change_s"]) == ("done", "sto", 30.0)
    assert [tool["pitch_mm"] for tool in plan["summary"]["tools"]] == [1.5, 1.0]
    assert run(["plans", "show", plan["id"]]) == 0
    assert "slope RMS" in capsys.readouterr().out
    written = tmp_path / "second.csv"
    say("plans", "export", plan["id"], "--format", "pvt.csv", "--tool", "2", "-o", str(written))
    assert written.read_text().count("\n") == plan["summary"]["tools"][1]["segments"] + 1
    for wrong in (["--tool", f"{influence}:pitch-mm=-1"], [influence, *tools], []):
        assert run(["plans", "create", surface, *wrong]) == 2


def test_the_machine_is_moved_between_runs(say: Say, capsys: pytest.CaptureFixture[str]) -> None:
    assert "seen" not in say("machine", "status")
    say("machine", "home")
    moved = say("machine", "move", "--x-mm", "2.5")
    assert {axis["coordinate"]: axis["position_mm"] for axis in moved["seen"]["axes"].values()}["x"] == 2.5
    say("machine", "move", "--x-mm", "1e6", code=3)
    assert run(["machine", "status"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert any(line.split()[:3] == ["A", "x", "2.5"] for line in told)


def test_what_is_refused_says_why(say: Say, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (("runs", "pause"), ("runs", "watch"), ("plans", "create", "x", "y", "--set", "pitch")):
        assert run([*arguments]) == 2
    assert "nothing runs" in capsys.readouterr().err
    assert run(["plans", "show", "absent"]) == 9
    assert "does not exist" in capsys.readouterr().err
    assert run(["maps", "list", "--url", "http://127.0.0.1:1"]) == 9
    assert "no service answers at http://127.0.0.1:1" in capsys.readouterr().err


def test_keys_come_from_the_environment(
    settings: Settings, say: Say, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _, token = KeyRing(settings.data).add("panel", Role.VIEW)
    assert run(["maps", "list"]) == 9
    assert "no valid key" in capsys.readouterr().err
    monkeypatch.setenv("IBFCTL_KEY", token)
    assert say("maps", "list") == {"items": []}
    say("influences", "add", TIF, code=9)
    assert say("abort")["aborted"] == []


class TestUnderWay:
    """A run that is under way."""

    @pytest.fixture
    def settings(self, settings: Settings) -> Settings:
        return dataclasses.replace(settings, speed=1.0)

    @pytest.fixture
    def moving(self, plan_id: str, client: httpx.Client) -> Iterator[str]:
        with Client(str(client.base_url)) as ibfctl:
            identity = ibfctl.runs.start(plan_id)["id"]
            deadline = time.monotonic() + PATIENCE_S
            while ibfctl.runs.show(identity)["state"] != "running":
                assert time.monotonic() < deadline
                time.sleep(0.02)
            yield identity

    def test_it_is_watched_to_its_end(
        self,
        moving: str,
        say: Say,
        settings: Settings,
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        def described(told: watch.Told) -> str:
            if told.get("gate") == "open":  # seen by whoever watches: it can be ended
                run(["abort", "--data", str(settings.data), "--url", "http://127.0.0.1:1"])
            return describe(told)

        describe = watch.describe
        monkeypatch.setattr(watch, "describe", described)
        assert say("runs", "show")["id"] == moving
        assert run(["runs", "watch"]) == 7
        told = capsys.readouterr()
        assert "running" in told.err
        assert "gate open" in told.err
        assert told.err.rstrip().splitlines()[-1].startswith("error: ")
        assert f"aborted  {moving}" in told.out

    def test_it_is_aborted_by_a_service_elsewhere(self, moving: str, say: Say, tmp_path: Path) -> None:
        assert say("abort", "--data", str(tmp_path / "empty")) == {"aborted": [moving]}
        assert say("runs", "watch", moving, code=7)["state"] == "aborted"


def test_where_nothing_answers_an_abort_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["abort", "--data", str(tmp_path), "--url", "http://127.0.0.1:1"]) == 5
    assert "use the machine's own stop" in capsys.readouterr().err
