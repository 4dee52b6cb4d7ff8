"""The configuration file of the service: TOML, validated, unknown keys refused; secrets are never in it."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from ibfctl.errors import InputError
from ibfctl.files import state_folder
from ibfctl.machine.shipped import machine_file
from ibfctl.service.settings import Settings

_FOLDERED = ("data", "tls_certificate", "tls_key")


class ServiceConfig(BaseModel):
    """Everything that `ibfctl serve` can be told, by file or by option."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8000
    data: Path = Field(default_factory=state_folder)
    machine: str | None = None
    simulate: bool = False
    speed: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    max_upload_bytes: Annotated[int, Field(ge=1)] = 1 << 30
    max_map_pixels: Annotated[int, Field(ge=1)] = 1 << 26
    tls_certificate: Path | None = None
    tls_key: Path | None = None

    @model_validator(mode="after")
    def _certificate_with_its_key(self) -> Self:
        if (self.tls_certificate is None) != (self.tls_key is None):
            raise ValueError("tls_certificate and tls_key need each other")
        return self

    def settings(self) -> Settings:
        """Return what the application itself needs to know."""
        if self.machine is None and not self.simulate:
            raise InputError("serve: no machine is given", "give --machine FILE, or --simulate")
        return Settings(
            self.data.absolute(),
            machine_file(self.machine or "simulator").absolute(),
            self.simulate,
            self.speed,
            self.max_upload_bytes,
            self.max_map_pixels,
        )


def read_config(path: Path | None, options: dict[str, Any]) -> ServiceConfig:
    """Return the configuration of a file, if one is given, with options in place of what it says.

    Paths in the file are relative to its folder.

    Raises
    ------
    InputError
        If the file cannot be read, or holds a key or value that is not allowed.
    """
    try:
        told = tomllib.loads(path.read_text(encoding="utf-8")) if path is not None else {}
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"config {path}: cannot be read ({error})", "check the path and the line named") from error
    if path is not None:
        told |= {
            name: str(path.absolute().parent / told[name]) for name in _FOLDERED if isinstance(told.get(name), str)
        }
        machine = told.get("machine")
        if isinstance(machine, str) and (path.absolute().parent / machine).is_file():
            told["machine"] = str(path.absolute().parent / machine)
    try:
        return ServiceConfig.model_validate(told | options)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "top level"
        raise InputError(
            f"config {path or 'given by options'}: {place}: {first['msg']}", "docs/command-line.md lists all keys"
        ) from error
