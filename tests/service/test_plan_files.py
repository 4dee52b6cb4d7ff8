"""A plan that was made elsewhere, e.g. for the rest of a run, is run by the service."""

from pathlib import Path

import httpx
import pytest

from ibfctl.cli.main import run
from ibfctl.service.settings import Settings
from ibfctl.service.store import Collection
from tests.support.served import ended


@pytest.fixture
def plan_file(plan_id: str, settings: Settings, tmp_path: Path) -> Path:
    """A plan of this service, which it shall have forgotten."""
    plans = Collection(settings.data, "plans")
    file = plans.path(plan_id, "plan.h5").rename(tmp_path / "rest.h5")
    plans.delete(plan_id)
    return file


def test_it_is_run_as_any_other(plan_file: Path, client: httpx.Client) -> None:
    asked = {"content": plan_file.read_bytes(), "headers": {"Idempotency-Key": "once"}}
    plan, again = (client.post("/v1/plan-files", **asked).raise_for_status().json() for _ in range(2))  # type: ignore[arg-type]
    assert plan == again == client.get(plan["links"]["self"]).json()
    assert plan["state"] == "done"
    assert client.get(plan["links"]["plan.pvt.csv"]).status_code == 200
    made = ended(client, client.post("/v1/runs", json={"plan_id": plan["id"]}).headers["Location"])
    assert made["state"] == "completed", made
    assert made["figures"]["as_run_rms_nm"] == pytest.approx(plan["summary"]["executed_rms_nm"], abs=1e-3)
    assert client.delete(plan["links"]["self"]).status_code == 409


def test_one_that_was_changed_is_refused(plan_file: Path, client: httpx.Client) -> None:
    changed = bytearray(plan_file.read_bytes())
    changed[len(changed) // 2] ^= 1
    for content in (bytes(changed), b"no plan", b""):
        refused = client.post("/v1/plan-files", content=content)
        assert (refused.status_code, refused.json()["code"]) == (422, "bad_input")
        assert "plan file plan.h5: cannot be read" in refused.json()["detail"]
    assert client.get("/v1/plans").json()["items"] == []
    assert client.post("/v1/plan-files?machine_id=absent", content=plan_file.read_bytes()).status_code == 404


def test_the_command_line_brings_it(
    plan_file: Path, client: httpx.Client, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("IBFCTL_URL", str(client.base_url))
    assert run(["plans", "add", str(plan_file)]) == 0
    (plan,) = client.get("/v1/plans").json()["items"]
    assert plan["id"] in capsys.readouterr().out
    assert run(["plans", "add", str(plan_file.with_name("absent.h5"))]) == 2
    assert "absent.h5" in capsys.readouterr().err
