"""What the service answers: every field with its unit in its name."""

from __future__ import annotations

from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from ibfctl.machine.description import MachineDescription
from ibfctl.runs.states import RunState
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


class Place(BaseModel):
    """Where a run is."""

    model_config = ConfigDict(extra="allow")

    plan_sample: int | None = None
    segment: int | None = None
    x_mm: float | None = None
    y_mm: float | None = None


class InterlockStatus(BaseModel):
    """An interlock: its last value, and whether that is in its band."""

    value: float | None = None
    ok: bool


class RunStatus(BaseModel):
    """What a run's worker tells about ten times a second; a field is absent until it is known."""

    model_config = ConfigDict(extra="allow")

    run: str
    state: RunState
    seq: Annotated[int, Field(description="Grows with every status.")]
    at: Annotated[str, Field(description="UTC, ISO 8601.")]
    simulated: bool | None = None
    code: Annotated[str | None, Field(description="What ended it: `code` of its error.")] = None
    reason: str | None = None
    hint: str | None = None
    tool: Annotated[int | None, Field(description="Which of several tools is under way, from one.")] = None
    tools: Annotated[int | None, Field(description="How many there are.")] = None
    place: Place | None = None
    sent: Annotated[int | None, Field(description="Segments given to the controller.")] = None
    executed: Annotated[int | None, Field(description="Segments that it has executed.")] = None
    total: Annotated[int | None, Field(description="Segments of the plan.")] = None
    margin_s: Annotated[float | None, Field(description="Motion that the controller's buffer surely holds.")] = None
    minimum_margin_s: Annotated[float | None, Field(description="The least of it so far.")] = None
    gate: Literal["open", "closed", "unknown"] | None = None
    progress: Annotated[float | None, Field(description="Share of the plan's time, 0 to 1.")] = None
    eta_s: Annotated[float | None, Field(description="Time to the end.")] = None
    eta_pause_s: Annotated[float | None, Field(description="Time to the next place where it would pause.")] = None
    residual_rms_nm: Annotated[float | None, Field(description="Residual that the run so far leaves.")] = None
    journal_ok: Annotated[bool | None, Field(description="False while the journal cannot be written.")] = None
    interlocks: dict[str, InterlockStatus] | None = None
    worker_pid: int | None = None


class RunFigures(BaseModel):
    """What a run has left: the figures of its run file."""

    model_config = ConfigDict(extra="allow")

    as_run_rms_nm: float | None = None
    as_run_pv_nm: float | None = None
    max_difference_nm: Annotated[float | None, Field(description="As-run against executed removal, largest.")] = None


class Recovered(BaseModel):
    """What is known of an interrupted run, by the controller's own stamps or by what its worker told last."""

    model_config = ConfigDict(extra="allow")

    can_resume: bool
    why_not: str = ""
    hint: str = ""
    executed: Annotated[list[tuple[int, int]], Field(description="Parts executed with the gate open, samples.")] = []
    uncertainty_samples: Annotated[int, Field(description="How much later the last part may have ended.")] = 0
    seam: Annotated[int | None, Field(description="Where it would go on, samples of the plan.")] = None


class RunRecord(Resource):
    """A run: `status` while its worker lives, then `figures` or `error`."""

    state: RunState
    plan_id: str
    simulated: bool
    operator: str
    status: RunStatus | None = None
    figures: RunFigures | None = None
    recovered: Recovered | None = None
    error: Problem | None = None


class Told(BaseModel):
    """Who was told."""

    runs: Annotated[list[str], Field(description="Ids of runs and of acts on the machine.")]


class MachineAct(BaseModel):
    """An act on the machine that is no run."""

    id: str
    name: Literal["connect", "home", "move", "gate-test", "estop"]
    state: Literal["running", "done", "failed"]
    begun: Annotated[str, Field(description="UTC, ISO 8601.")]
    operator: str
    error: Problem | None = None


class AxisSeen(BaseModel):
    """One axis as the controller told it."""

    coordinate: Literal["x", "y"]
    position_mm: Annotated[float, Field(description="Coordinate of the machine.")]
    position_counts: int
    error_counts: Annotated[int, Field(description="Following error.")]
    stop_code: Annotated[int, Field(description="Galil's SC.")]
    moving: bool
    motor_on: bool
    homed: Annotated[bool, Field(description="Whether it knows where it is.")]


class MachineSeen(BaseModel):
    """What the last act saw at its end."""

    at: Annotated[str, Field(description="UTC, ISO 8601.")]
    model: Annotated[str, Field(description="Who answers: model and firmware.")]
    axes: Annotated[dict[str, AxisSeen], Field(description="By the controller's letter.")]
    gate: Literal["open", "closed"]
    latched: Annotated[bool, Field(description="Whether an emergency stop is latched: nothing moves.")]
    sample_period_s: Annotated[float | None, Field(description="As measured by `connect`.")] = None


class MachineNow(BaseModel):
    """The machine of the service."""

    name: Annotated[str, Field(description="In its machine file.")]
    simulated: Annotated[bool, Field(description="Whether its controller is an emulated one.")]
    running: Annotated[list[str], Field(description="Ids of the runs under way.")]
    act: Annotated[MachineAct | None, Field(description="The last act that was asked for.")] = None
    seen: MachineSeen | None = None
    links: Links


class Info(BaseModel):
    """The service itself."""

    version: str
    machine: Annotated[str, Field(description="Name in the machine file.")]
    simulated: Annotated[bool, Field(description="Whether runs go to emulated controllers.")]
    running: Annotated[list[str], Field(description="Ids of the runs under way.")]


class Health(BaseModel):
    """That the service answers."""

    status: Literal["ok"]
