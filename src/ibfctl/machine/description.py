"""The machine file: TOML, validated, unknown keys refused.

Machine limits come from this file alone, never from an environment variable: a limit that
depends on a shell's state is no limit.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from ibfctl.errors import InputError

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
AxisLetter = Literal["A", "B", "C", "D", "E", "F", "G", "H"]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Axis(_Section):
    """One stage: which coordinate it moves, its scale, its travel and its limits."""

    coordinate: Literal["x", "y"]
    counts_per_mm: Positive
    direction: Literal[1, -1] = 1
    travel_min_mm: Finite
    travel_max_mm: Finite
    v_max_mm_s: Positive
    a_max_mm_s2: Positive
    j_max_mm_s3: Positive | None = None
    home_mm: Finite = 0.0

    @model_validator(mode="after")
    def _travel_is_a_range(self) -> Self:
        if self.travel_min_mm >= self.travel_max_mm:
            raise ValueError("travel_min_mm must be smaller than travel_max_mm")
        return self

    @property
    def signed_counts_per_mm(self) -> float:
        """Counts per mm of the coordinate, negative where the axis counts against it."""
        return self.direction * self.counts_per_mm


class Servo(_Section):
    """How the controller is set up before a run."""

    error_limit_counts: Annotated[int, Field(ge=1, le=2_147_483_647)] = 16384
    off_on_error: Literal[0, 1, 2, 3] = 1
    position_tolerance_counts: Annotated[int, Field(ge=0)] = 20
    approach_speed_mm_s: Positive = 20.0
    approach_acceleration_mm_s2: Positive = 200.0
    settle_timeout_s: Positive = 120.0


class Homing(_Section):
    """How the axes learn where they are after power-up."""

    method: Literal["absolute", "switch", "index"] = "switch"
    speed_mm_s: Positive = 5.0
    creep_mm_s: Positive = 0.5


class BeamGate(_Section):
    """The digital output that opens the beam, its sense, and how long the host may be silent meanwhile."""

    output: Annotated[int, Field(ge=1, le=80)]
    open_when: Literal["set", "clear"] = "set"
    guard_patience_s: Annotated[float, Field(ge=0.3, le=60)] = 0.4


class Interlock(_Section):
    """A condition that must hold while the beam is on."""

    name: Annotated[str, Field(min_length=1, max_length=60)]
    source: Annotated[str, Field(pattern=r"^(pushed|digital ([1-9]|[1-7][0-9]|80)|analog [1-8])$")]
    min: Finite
    max: Finite
    settle_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    stale_s: Positive = 10.0

    @model_validator(mode="after")
    def _band_is_a_range(self) -> Self:
        if self.min > self.max:
            raise ValueError("min must not be greater than max")
        return self

    @property
    def kind(self) -> str:
        """Return "digital", "analog" or "pushed"."""
        return self.source.partition(" ")[0]

    @property
    def number(self) -> int:
        """Number of the input; 0 where the value is pushed."""
        return int(self.source.partition(" ")[2] or 0)


class Connection(_Section):
    """Where the controller listens, and how long a reply may take; a serial port takes the place of host and port."""

    driver: str = "galil"
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=1, le=65535)] = 23
    serial: str | None = None
    baud: Annotated[int, Field(ge=9600, le=921_600)] = 115_200
    timeout_s: Positive = 2.0


class MachineDescription(_Section):
    """A whole machine file."""

    name: str
    sample_period_s: Positive = 1 / 1024
    axes: dict[AxisLetter, Axis]
    servo: Servo = Servo()
    homing: Homing = Homing()
    beam_gate: BeamGate
    connection: Connection = Connection()
    interlocks: tuple[Interlock, ...] = ()

    @model_validator(mode="after")
    def _one_axis_per_coordinate(self) -> Self:
        if sorted(axis.coordinate for axis in self.axes.values()) != ["x", "y"]:
            raise ValueError("axes must hold exactly one axis for x and one for y")
        return self

    @field_validator("interlocks", mode="before")
    @classmethod
    def _tables(cls, value: object) -> object:
        return tuple(value) if isinstance(value, list) else value

    @model_validator(mode="after")
    def _interlocks_have_names(self) -> Self:
        names = [interlock.name for interlock in self.interlocks]
        if len(set(names)) != len(names):
            raise ValueError("interlocks must have different names")
        return self

    def without_limits(self) -> MachineDescription:
        """Return the same machine with travel, speed and acceleration that no finishing job feels."""
        free = {
            "travel_min_mm": -1e4,
            "travel_max_mm": 1e4,
            "v_max_mm_s": 2000.0,
            "a_max_mm_s2": 1e6,
            "j_max_mm_s3": None,
        }
        axes = {letter: axis.model_copy(update=free) for letter, axis in self.axes.items()}
        return self.model_copy(update={"axes": axes})

    def letter_of(self, coordinate: str) -> str:
        """Return the letter of the axis that moves `coordinate`."""
        return next(letter for letter, axis in self.axes.items() if axis.coordinate == coordinate)

    def axis_of(self, coordinate: str) -> Axis:
        """Return the axis that moves `coordinate` ("x" or "y")."""
        return next(axis for axis in self.axes.values() if axis.coordinate == coordinate)


def read_machine(path: Path) -> MachineDescription:
    """Read and validate a machine file.

    Raises
    ------
    InputError
        If the file cannot be read, is no TOML, or holds a key or value that is not allowed.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"machine file {path}: cannot be read ({error})", "check the path given to --machine"
        ) from error
    return parse_machine(text, str(path))


def parse_machine(text: str, where: str) -> MachineDescription:
    """Validate the text of a machine file; `where` names it in messages."""
    try:
        return MachineDescription.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"machine file {where}: not valid TOML ({error})", "correct the line named") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "top level"
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        raise InputError(
            f"machine file {where}: {place}: {first['msg']}{more}",
            "correct the key; docs/machine-file.md lists all keys with their units",
        ) from error
