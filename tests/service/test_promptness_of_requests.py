"""No request takes the way to a thread and back: on a busy host that costs more than all the rest of it."""

import dataclasses
from typing import Any

import fastapi.dependencies.utils
import fastapi.routing
import pytest

from ibfctl.service.settings import Settings
from tests.support.served import serving


def test_requests_stay_in_the_event_loop(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    elsewhere = []

    async def noted(call: Any, *arguments: Any, **named: Any) -> Any:
        elsewhere.append(call)
        return call(*arguments, **named)

    for module in (fastapi.routing, fastapi.dependencies.utils):
        monkeypatch.setattr(module, "run_in_threadpool", noted)
    with serving(dataclasses.replace(settings, simulate=False)) as client:
        paths = client.get("/openapi.json").json()["paths"]
        for path in paths:
            if path != "/v1/events":
                client.get(path.replace("{identity}", "absent").replace("{name}", "run.h5"))
        assert client.post("/v1/abort").status_code == 202
    assert elsewhere == []
