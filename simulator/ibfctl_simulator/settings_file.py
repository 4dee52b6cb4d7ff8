"""Settings of the emulated controller from a TOML file whose keys are the fields of `Settings`."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

from ibfctl_simulator.galil.servo import ServoModel
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.switches import SwitchPlaces

TABLES: dict[str, type[Any]] = {"servo": ServoModel, "switches": SwitchPlaces}


def read_settings(path: Path) -> Settings:
    """Read settings.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is no TOML, or a key or value is not allowed; the message says which.
    """
    values = tomllib.loads(path.read_text(encoding="utf-8"))
    for name, kind in TABLES.items():
        if name in values:
            values[name] = _make(kind, values[name], f"{name}.")
    made = _make(Settings, values, "")
    assert isinstance(made, Settings)
    return made


def _make(kind: type[Any], values: Any, prefix: str) -> Any:
    if not isinstance(values, dict):
        raise ValueError(f"{prefix.rstrip('.')}: a table is needed")
    default = kind()
    for name, value in values.items():
        if name not in {field.name for field in dataclasses.fields(kind)}:
            raise ValueError(f"{prefix}{name}: unknown key")
        expected = getattr(default, name)
        if not _fits(value, 0.0 if expected is None else expected):
            raise ValueError(f"{prefix}{name}: {value!r} is not of the kind of {expected!r}")
    return kind(**values)


def _fits(value: Any, expected: Any) -> bool:
    if isinstance(expected, float):
        return isinstance(value, int | float) and not isinstance(value, bool)
    return type(value) is type(expected)
