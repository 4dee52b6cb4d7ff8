"""What the service answers, for type checkers; docs/rest.md says what it means."""

from __future__ import annotations

from typing import Any, Literal, NotRequired, TypedDict

RunState = Literal[
    "queued",
    "preflight",
    "moving_to_start",
    "armed",
    "running",
    "pausing",
    "paused",
    "resuming",
    "finishing",
    "tool_change",
    "completed",
    "stopped",
    "aborted",
    "faulted",
    "interrupted",
    "estopped",
]
OVER = frozenset({"completed", "stopped", "aborted", "faulted", "interrupted", "estopped"})
"""States in which a run no longer moves."""


class Problem(TypedDict):
    """Why something failed."""

    status: int
    code: str
    title: str
    detail: str
    hint: str


class Resource(TypedDict):
    """What all resources have."""

    id: str
    created: str
    links: dict[str, str]


class Map(Resource):
    """A surface map."""

    format: str
    bytes: int
    sha256: str
    given: dict[str, Any]
    figures: dict[str, Any]


class Influence(Resource):
    """A tool influence function."""

    format: NotRequired[str]
    formula: NotRequired[str]
    given: dict[str, Any]
    figures: dict[str, Any]


class Machine(Resource):
    """A machine file."""

    sha256: str
    machine: dict[str, Any]


class PlanProgress(TypedDict):
    """How far the planning is."""

    stage: str
    fraction: float


class Plan(Resource):
    """A plan."""

    state: Literal["queued", "running", "done", "failed"]
    request: dict[str, Any]
    progress: NotRequired[PlanProgress]
    summary: NotRequired[dict[str, Any]]
    error: NotRequired[Problem]


class Place(TypedDict, total=False):
    """Where a run is."""

    plan_sample: int
    segment: int
    x_mm: float
    y_mm: float


class RunStatus(TypedDict, total=False):
    """What a run's worker tells."""

    run: str
    state: RunState
    seq: int
    at: str
    code: str | None
    reason: str | None
    hint: str | None
    place: Place
    sent: int
    executed: int
    total: int
    margin_s: float
    minimum_margin_s: float
    gate: Literal["open", "closed", "unknown"]
    progress: float
    eta_s: float
    eta_pause_s: float
    residual_rms_nm: float
    journal_ok: bool
    interlocks: dict[str, dict[str, Any]]


class Recovered(TypedDict):
    """What is known of a run whose worker has not told its end."""

    can_resume: bool
    why_not: NotRequired[str]
    hint: NotRequired[str]
    executed: NotRequired[list[tuple[int, int]]]
    uncertainty_samples: NotRequired[int]
    seam: NotRequired[int]


class Run(Resource):
    """A run."""

    state: RunState
    plan_id: str
    simulated: bool
    operator: str
    status: NotRequired[RunStatus]
    figures: NotRequired[dict[str, Any]]
    recovered: NotRequired[Recovered]
    error: NotRequired[Problem]


class MachineAct(TypedDict):
    """An act on the machine that is no run."""

    id: str
    name: str
    state: Literal["running", "done", "failed"]
    begun: str
    operator: str
    error: NotRequired[Problem]


class MachineSeen(TypedDict):
    """What an act saw at its end."""

    at: str
    model: str
    axes: dict[str, dict[str, Any]]
    gate: Literal["open", "closed"]
    latched: bool
    sample_period_s: NotRequired[float]


class MachineNow(TypedDict):
    """The machine of the service."""

    name: str
    simulated: bool
    running: list[str]
    act: NotRequired[MachineAct]
    seen: NotRequired[MachineSeen]
    links: dict[str, str]


class Event(TypedDict):
    """One event; `id` is None for telemetry."""

    id: int | None
    event: str
    data: dict[str, Any]
