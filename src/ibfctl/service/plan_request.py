"""The body of a plan: what to plan, with one tool or several, and the choices about it."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ibfctl.service.part import Aperture, Count, Placing, Positive, Yes

Path = Literal["raster", "maze", "spiral", "random"]
Axis = Literal["x", "y"]
MOST_TOOLS = 8

_EXAMPLE: dict[str, Any] = {
    "map_id": "019ab2c4d5e6f708",
    "influence_id": "019ab2c4d5e6f709",
    "pitch_mm": 1.0,
    "max_residual_nm": 0.5,
}
_SEVERAL: dict[str, Any] = {
    "map_id": "019ab2c4d5e6f708",
    "tools": [
        {"influence_id": "019ab2c4d5e6f709", "pitch_mm": 1.5},
        {"influence_id": "019ab2c4d5e6f70a", "pitch_mm": 0.8, "path": "maze"},
    ],
    "tool_change_s": 600.0,
    "seconds_per_nm": 120.0,
}

_AIMS = ("margin", "max_time_s", "max_residual_nm", "seconds_per_nm")


def _nothing_but(name: str, *names: str) -> dict[str, Any]:
    """Describe a body that gives of `names` at most `name`."""
    return {"properties": {other: {"type": "null"} for other in names if other != name}}


_ONE_ALONE: dict[str, Any] = {
    "required": ["influence_id"],
    "properties": {"influence_id": {"type": "string"}, "tools": {"type": "null"}},
}
_TOGETHER: dict[str, Any] = {
    "required": ["tools"],
    "properties": {
        "influence_id": {"type": "null"},
        "tools": {"type": "array"},
        **{name: {"const": False} for name in ("trade_off", "l_curve")},
    },
}
_SCHEMA: dict[str, Any] = {
    "examples": [_EXAMPLE, _SEVERAL],
    "allOf": [{"oneOf": [_ONE_ALONE, _TOGETHER]}, {"anyOf": [_nothing_but(aim, *_AIMS) for aim in _AIMS]}],
}
"""With what the validators of `PlanRequest` ask for."""


class ToolRequest(BaseModel):
    """One of several tools; what is left out is as for the whole plan."""

    model_config = ConfigDict(extra="forbid")

    influence_id: str
    machine_id: Annotated[str | None, Field(description="Machine that moves it.")] = None
    path: Path | None = None
    scan_axis: Axis | None = None
    pitch_mm: Positive | None = None
    step_mm: Positive | None = None


class PlanRequest(BaseModel):
    """What to plan; options as those of `ibfctl plan`."""

    model_config = ConfigDict(extra="forbid", json_schema_extra=_SCHEMA)

    map_id: str
    influence_id: Annotated[str | None, Field(description="The tool, where there is one alone.")] = None
    tools: Annotated[
        list[ToolRequest] | None,
        Field(min_length=1, max_length=MOST_TOOLS, description="Several tools in its place; the widest runs first."),
    ] = None
    method: Annotated[
        Literal["ours", "mto", "sto"],
        Field(description="Dwell times of several tools: ours, or those of Ke et al. 2022, all at once or in turn."),
    ] = "ours"
    tool_change_s: Annotated[
        float,
        Field(
            ge=0,
            allow_inf_nan=False,
            strict=True,
            description="Of several tools: time of a change; counts in the total.",
        ),
    ] = 0.0
    machine_id: Annotated[str | None, Field(description="Machine to plan for; default: the service's own.")] = None
    path: Path = "raster"
    inside_out: Annotated[Yes, Field(description="A spiral starts in the middle.")] = False
    seed: Count = 0
    pitch_mm: Annotated[
        Positive | None, Field(description="Distance between lines; default: a quarter of the tool's full width.")
    ] = None
    step_mm: Annotated[Positive | None, Field(description="Between nodes on a line; default: the pitch.")] = None
    scan_axis: Axis = "x"
    clear_aperture_mm: Annotated[
        Aperture | None,
        Field(description="x0, x1, y0, y1, or a circle, a polygon or a mask; default: the whole map."),
    ] = None
    remove: Annotated[
        str, Field(pattern=r"^(none|piston|tilt|power|legendre:[0-8]|zernike:([1-9]|[123]\d|4[0-5]))$")
    ] = "tilt"
    extra_removal_nm: Annotated[Positive | None, Field(description="Depth that every place must lose.")] = None
    placement: Annotated[
        Placing | None, Field(description="How the part stands on the machine; default: in its coordinates.")
    ] = None
    dwell_min_s: Positive | None = None
    v_min_mm_s: Annotated[
        Positive | None, Field(description="Slowest mean speed over a step: an upper bound of every dwell time.")
    ] = None
    dwell_bounds: Annotated[
        Literal["machine", "ramp"],
        Field(description="Shortest times of the machine, or also the bounds of linear ramps."),
    ] = "machine"
    corridor_mm: Positive | None = None
    corner_tolerance_mm: Annotated[
        Positive | None, Field(description="Round corners, leaving the programmed path by no more.")
    ] = None
    loop: Annotated[Yes, Field(description="Correct dwell times for the motion executed.")] = True
    margin: Annotated[
        float | None,
        Field(ge=0, le=10, strict=True, description="Share of the residual given for time; default: 0.01."),
    ] = None
    max_time_s: Annotated[Positive | None, Field(description="The best residual within this run time.")] = None
    max_residual_nm: Annotated[Positive | None, Field(description="The shortest run to this residual, RMS.")] = None
    seconds_per_nm: Annotated[
        Positive | None, Field(description="Time that a nm of residual, RMS, is worth: the best balance of both.")
    ] = None
    tikhonov: Annotated[float, Field(ge=0, le=1, strict=True, description="Relative to the largest eigenvalue.")] = 1e-8
    l_curve: Annotated[Yes, Field(description="Find the Tikhonov factor by the L-curve.")] = False
    trade_off: Annotated[Yes, Field(description="Add the curve of residual against time.")] = False

    @model_validator(mode="after")
    def _one_aim(self) -> Self:
        if sum(getattr(self, aim) is not None for aim in _AIMS) > 1:
            raise ValueError(f"{', '.join(_AIMS)} exclude each other")
        return self

    @model_validator(mode="after")
    def _one_tool_or_several(self) -> Self:
        if (self.influence_id is None) == (self.tools is None):
            raise ValueError("give either influence_id or tools")
        if self.tools is not None and (self.trade_off or self.l_curve):
            raise ValueError("trade_off and l_curve are for one tool")
        return self
