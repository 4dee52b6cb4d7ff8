"""Live events: the journal with replay, and the newest status of every run."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Header, Query
from pydantic import Field
from pydantic.json_schema import SkipJsonSchema
from starlette.responses import StreamingResponse

from ibfctl.service.requests import Digits, refusals
from ibfctl.service.state import Service

router = APIRouter(prefix="/events", tags=["events"])
_MEDIA_TYPE = "text/event-stream"
_EXAMPLE = """id: 17
event: state
data: {"run": "019ab2c4d5e6f708", "at": "2026-01-31T12:00:00.000+00:00", "key": null, "state": "running"}

event: telemetry
data: {"run": "019ab2c4d5e6f708", "seq": 42, "progress": 0.31, "margin_s": 1.9, "gate": "open"}

"""
_TEXT = {"type": "string"}
_EVENT = {
    "type": "object",
    "description": "One event of the stream; `id` is absent for telemetry, `data` is JSON.",
    "properties": {"id": _TEXT, "event": _TEXT, "data": _TEXT},
}
_STREAM: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "Server-sent events.",
        "content": {_MEDIA_TYPE: {"schema": _EVENT, "example": _EXAMPLE}},
    }
}
_Number = Annotated[int, Field(ge=0), Digits]
_Place = Annotated[_Number | None, Query(description="As the header Last-Event-ID, which comes before it.")]


@router.get("", response_class=StreamingResponse, responses={**_STREAM, **refusals()})
async def stream_events(
    service: Service,
    run: Annotated[str | None, Query(min_length=1, description="Only what concerns this run.")] = None,
    after: _Place = None,
    last_event_id: Annotated[
        _Number | SkipJsonSchema[None], Header(description="Replay the journal after this event.")
    ] = None,
    follow: Annotated[
        Literal["true", "false"], Query(description="Go on with what comes; false: end with what is there.")
    ] = "true",
) -> StreamingResponse:
    """Stream events: those of the journal with their ids, and `telemetry`, the status of runs up to 10 times a second.

    A listener that is slow misses samples of the telemetry, and no event of the journal.
    """
    place = last_event_id if last_event_id is not None else after
    frames = service.events.stream(place, run, follow=follow == "true")
    return StreamingResponse(frames, media_type=_MEDIA_TYPE, headers={"Cache-Control": "no-store"})
