"""Every refusal is problem JSON with a stable code."""

from pathlib import Path
from typing import Any

import httpx
import pytest

from ibfctl.machine.description import read_machine
from ibfctl.service.settings import Settings
from tests.support.served import ended, serving
from tests.support.small_job import TIF, SmallJob

MEMBERS = {"type", "title", "status", "detail", "code", "hint"}


def _problem(answer: Any, status: int, code: str) -> dict[str, Any]:
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    content: dict[str, Any] = answer.json()
    assert set(content) == MEMBERS
    assert (content["status"], content["code"]) == (status, code)
    assert content["detail"]
    assert content["hint"]
    return content


@pytest.mark.parametrize("kind", ["maps", "influences", "plans", "runs"])
@pytest.mark.parametrize("identity", ["0123456789abcdef", "..%2F..%2Fetc", "x" * 400])
def test_what_does_not_exist_is_not_found(client: httpx.Client, kind: str, identity: str) -> None:
    _problem(client.get(f"/v1/{kind}/{identity}"), 404, "not_found")


def test_an_unreadable_map_is_refused_and_not_kept(client: httpx.Client, settings: Settings) -> None:
    found = _problem(client.post("/v1/maps", params={"format": "npz"}, content=b"rubbish"), 422, "bad_input")
    assert str(settings.data) not in found["detail"]
    assert client.get("/v1/maps").json() == {"items": []}
    assert [path.name for path in (settings.data / "maps").iterdir()] == ["keys"]


def test_a_map_without_units_needs_them(client: httpx.Client) -> None:
    text = "x,y,z\n0,0,1\n1,0,2\n0,1,3\n1,1,4\n"
    _problem(client.post("/v1/maps", params={"format": "csv"}, content=text), 422, "bad_input")
    given = {"format": "csv", "pixel_mm": 0.5, "unit": "nm"}
    assert client.post("/v1/maps", params=given, content=text).json()["figures"]["pixel_mm"] == 0.5


def test_a_body_beyond_the_limit_is_refused_while_it_arrives(tmp_path: Path, settings: Settings) -> None:
    small = Settings(tmp_path / "small", settings.machine, max_upload_bytes=1000)
    with serving(small) as client:
        _problem(client.post("/v1/maps", params={"format": "npz"}, content=bytes(1001)), 413, "too_large")
    assert [path.name for path in (small.data / "maps").iterdir()] == ["keys"]


def test_requests_that_do_not_fit_name_the_place(client: httpx.Client) -> None:
    found = _problem(client.post("/v1/maps", params={"format": "docx"}, content=b""), 422, "bad_request")
    assert "format" in found["detail"]
    found = _problem(client.post("/v1/plans", json={"map_id": "x", "speed": 3}), 422, "bad_request")
    assert "speed" in found["detail"]
    assert "influence_id" in _problem(client.post("/v1/plans", json={"map_id": "x"}), 422, "bad_request")["detail"]
    aims = {"map_id": "x", "influence_id": "y", "max_time_s": 1, "max_residual_nm": 1}
    assert "exclude each other" in _problem(client.post("/v1/plans", json=aims), 422, "bad_request")["detail"]
    _problem(client.post("/v1/influences"), 422, "refused")
    for place in ("/v1/maps?limit=1.0", "/v1/events?after=0.0&follow=false"):
        assert "digits" in _problem(client.get(place), 422, "bad_request")["detail"]
    assert "lmit" in _problem(client.get("/v1/maps", params={"lmit": 3}), 422, "bad_request")["detail"]
    _problem(client.get("/v1/maps?limit=1&limit=2"), 422, "bad_request")
    _problem(client.post("/v1/plans", content="{", headers={"Content-Type": "application/json"}), 422, "bad_request")
    refusal = client.delete("/v1/maps")
    _problem(refusal, 405, "method_not_allowed")
    assert refusal.headers["allow"] == "GET, POST"


def test_a_plan_that_cannot_be_made_says_why(client: httpx.Client, small_job: SmallJob) -> None:
    surface = client.post("/v1/maps", params={"format": "npz"}, content=small_job.map.read_bytes()).json()
    influence = client.post("/v1/influences", params={"formula": TIF}).json()
    request = {"map_id": surface["id"], "influence_id": influence["id"], "clear_aperture_mm": [50, 60, 50, 60]}
    place = client.post("/v1/plans", json=request).headers["Location"]
    plan = ended(client, place)
    assert (plan["state"], plan["error"]["code"]) == ("failed", "bad_input")
    assert "clear aperture" in plan["error"]["detail"]
    _problem(client.post("/v1/runs", json={"plan_id": plan["id"]}), 409, "conflict")
    _problem(client.get(f"{place}/files/plan.h5"), 409, "conflict")


def test_an_unreachable_controller_fails_the_run(tmp_path: Path, plan_id: str, settings: Settings) -> None:
    machine = tmp_path / "machine.toml"
    machine.write_text(settings.machine.read_text().replace("port = 5023", "port = 1"))
    assert read_machine(machine).connection.port == 1
    with serving(Settings(settings.data, machine)) as client:
        run = ended(client, client.post("/v1/runs", json={"plan_id": plan_id}).headers["Location"])
    assert (run["state"], run["error"]["code"]) == ("faulted", "link")
    assert "127.0.0.1:1" in run["error"]["detail"]


def test_work_that_a_restart_cut_off_is_said_to_have_failed(settings: Settings) -> None:
    from ibfctl.service.store import Collection

    plans = Collection(settings.data, "plans")
    identity = plans.create()
    plans.write(identity, {"state": "running", "request": {}})
    with serving(settings) as client:
        plan = client.get(f"/v1/plans/{identity}").json()
    assert (plan["state"], plan["error"]["code"]) == ("failed", "interrupted")


def test_the_description_of_the_service_comes_from_the_service(client: httpx.Client) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    assert {"/v1/maps", "/v1/influences", "/v1/plans", "/v1/runs", "/v1/runs/{identity}/abort"} <= set(paths)
    assert client.get("/docs").headers["content-type"].startswith("text/html")


def test_every_operation_parameter_and_body_is_described(client: httpx.Client) -> None:
    described = client.get("/openapi.json").json()
    schemas = described["components"]["schemas"]
    for path, operations in described["paths"].items():
        for method, operation in operations.items():
            assert operation["description"], (method, path)
            assert all(parameter["description"] for parameter in operation.get("parameters", [])), (method, path)
            body = operation.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema", {})
            names = [part["$ref"].rpartition("/")[2] for part in (body, *body.get("anyOf", [])) if "$ref" in part]
            for name in names:
                assert schemas[name].get("examples"), f"{name} has no example"


def test_the_service_loads_nothing_numerical() -> None:
    import subprocess
    import sys

    code = "import ibfctl.service.app, sys; print([m for m in ('numpy', 'scipy', 'h5py', 'osqp') if m in sys.modules])"
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stdout.strip() == "[]"
