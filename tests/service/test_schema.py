"""Every operation keeps to its description, whatever it is asked: schemathesis asks."""

from collections.abc import Iterator

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, given
from hypothesis import settings as examples
from schemathesis import Case, GenerationMode
from schemathesis.schemas import APIOperation
from schemathesis.specs.openapi.checks import positive_data_acceptance

from ibfctl.service.keys import KeyRing, Role
from ibfctl.service.settings import Settings
from tests.support.served import PATIENCE_S, serving

MAKES_SENSE = {("POST", f"/v1/{kind}") for kind in ("maps", "influences", "machines", "plan-files")}
ANYTHING = {"deadline": None, "suppress_health_check": list(HealthCheck), "database": None}


@pytest.fixture
def guarded(settings: Settings, plan_id: str) -> Iterator[httpx.Client]:
    """A service with keys and with something in it."""
    _, token = KeyRing(settings.data).add("schemathesis", Role.ADMIN)
    with serving(settings) as client:
        client.headers["Authorization"] = f"Bearer {token}"
        yield client


def _ask_everything(client: httpx.Client, count: int) -> int:
    """Ask every operation that many times for what fits its description, and for what does not; return how many."""
    schema = schemathesis.openapi.from_url(f"{client.base_url}/openapi.json")
    asked = 0
    for found in schema.get_all_operations():
        operation = found.ok()
        for mode in GenerationMode:

            @given(case=operation.as_strategy(generation_mode=mode))
            @examples(max_examples=count, derandomize=True, **ANYTHING)
            def ask(case: Case) -> None:
                nonlocal asked
                asked += 1
                _ask(case, client)

            if mode is GenerationMode.POSITIVE or _can_be_wrong(operation):
                ask()
    return asked


def _can_be_wrong(operation: APIOperation) -> bool:
    return bool(operation.body) or any(True for _ in operation.iter_parameters())


def _ask(case: Case, client: httpx.Client) -> None:
    """Ask once; an event stream is asked to end, and every other id is that of something that is there."""
    if case.path == "/v1/events" and case.query.get("follow", "true") == "true":
        case.query["follow"] = "false"
    known = {parameter.name for parameter in case.operation.query}
    for name in case.query.keys() - known:  # what is None would not be sent at all
        case.query[name] = case.query[name] or ""
    if "identity" in case.path_parameters and case.method == "GET" and len(case.path_parameters["identity"]) % 2:
        kind = case.path.split("/")[2]
        there = client.get(f"/v1/{kind}").json()["items"]
        case.path_parameters["identity"] = there[0]["id"] if there else "absent"
    # That a file or a formula must make sense is more than a schema can say.
    unsaid = [positive_data_acceptance] if (case.method, case.path) in MAKES_SENSE else []
    case.call_and_validate(
        headers={"Authorization": client.headers["Authorization"]}, excluded_checks=unsaid, timeout=PATIENCE_S
    )


def test_operations_keep_to_their_description(guarded: httpx.Client) -> None:
    operations = sum(len(methods) for methods in guarded.get("/openapi.json").json()["paths"].values())
    assert _ask_everything(guarded, 2) > operations


@pytest.mark.slow
def test_operations_keep_to_their_description_whatever_is_asked(guarded: httpx.Client) -> None:
    assert _ask_everything(guarded, 1000) > 1000
