"""What the service answers: every field with its unit in its name."""

from __future__ import annotations

from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from ibfctl.machine.description import MachineDescription
from ibfctl.service.problems import Problem

Item = TypeVar("Item")
ByAxis = dict[str, float]
Links = Annotated[dict[str, str], Field(description="Where this resource and its files are.")]


class Resource(BaseModel):
    """What all resources have."""

    id: Annotated[str, Field(examples=["019ab2c4d5e6f708"])]
    created: Annotated[str, Field(description="UTC, ISO 8601.", examples=["2026-01-31T12:00:00.000+00:00"])]
    links: Links


class Page(BaseModel, Generic[Item]):
    """One page of a list, oldest first."""

    items: list[Item]
    next: Annotated[str | None, Field(description="Where the next page is; absent on the last.")] = None


class MapFigures(BaseModel):
    """A map at a glance; RMS and PV of the heights as measured, without levelling."""

    nx: int
    ny: int
    pixel_mm: float
    x0_mm: Annotated[float, Field(description="Centre of pixel [0, 0] on the part.")]
    y0_mm: float
    valid_pixels: int
    rms_nm: float
    pv_nm: float


class MapRecord(Resource):
    """A surface map."""

    format: str
    bytes: int
    sha256: str
    given: Annotated[dict[str, Any], Field(description="What was given beside the file.")]
    figures: MapFigures


class InfluenceFigures(BaseModel):
    """An influence function at a glance."""

    nx: int
    ny: int
    pixel_mm: float
    radius_mm: float
    peak_rate_nm_s: float
    volume_rate_nm_mm2_s: float


class InfluenceRecord(Resource):
    """A tool influence function: a file or a formula."""

    format: str | None = None
    bytes: int | None = None
    sha256: str | None = None
    formula: str | None = None
    given: dict[str, Any]
    figures: InfluenceFigures


class MachineRecord(Resource):
    """A machine file: limits, servo, beam gate, and where the controller listens."""

    sha256: str
    machine: MachineDescription


class PlanProgress(BaseModel):
    """How far the planning is."""

    stage: str
    fraction: float


class PlanSummary(BaseModel):
    """The figures of `ibfctl plan --json`; values by axis letter where an axis is meant."""

    model_config = ConfigDict(extra="allow")

    initial_rms_nm: float
    initial_pv_nm: float
    ideal_rms_nm: float
    executed_rms_nm: float
    executed_pv_nm: float
    total_time_s: float
    nodes: int
    segments: int
    peak_velocity_mm_s: ByAxis
    peak_acceleration_mm_s2: ByAxis
    certificate: dict[str, Any]
    planning_time_s: float


class PlanRecord(Resource):
    """A plan: `progress` while it is solved, then `summary` or `error`."""

    state: Literal["queued", "running", "done", "failed"]
    request: dict[str, Any]
    progress: PlanProgress | None = None
    summary: PlanSummary | None = None
    error: Problem | None = None


class RunProgress(BaseModel):
    """How far a run is."""

    segment: Annotated[int, Field(description="Segments given to the controller.")]
    executed: int
    total: int
    margin_s: Annotated[float, Field(description="Motion that the controller's buffer surely still holds.")]
    gate: Literal["open", "closed"]


class RunFigures(BaseModel):
    """The figures of `ibfctl simulate --json`; residuals only where an emulated controller left a trace."""

    model_config = ConfigDict(extra="allow")

    as_run_rms_nm: float | None = None
    as_run_pv_nm: float | None = None
    max_difference_nm: float | None = None
    segments_executed: int
    final_position_error_counts: ByAxis
    minimum_buffer_margin_s: float
    stop_codes: ByAxis


class RunRecord(Resource):
    """A run: `progress` while it moves, then `figures` or `error`."""

    state: Literal["running", "done", "aborted", "failed"]
    plan_id: str
    simulated: bool
    progress: RunProgress | None = None
    figures: RunFigures | None = None
    error: Problem | None = None


class Info(BaseModel):
    """The service itself."""

    version: str
    machine: Annotated[str, Field(description="Name in the machine file.")]
    simulated: Annotated[bool, Field(description="Whether runs go to emulated controllers.")]
    running: Annotated[list[str], Field(description="Ids of the runs under way.")]


class Health(BaseModel):
    """That the service answers."""

    status: Literal["ok"]
