"""The machine files that come with the package."""

from __future__ import annotations

from pathlib import Path

from ibfctl.errors import InputError

_PACKAGE = Path(__file__).parents[1]
_FOLDERS = (_PACKAGE / "config" / "machines", _PACKAGE.parents[1] / "config" / "machines")


def shipped_machine(name: str) -> Path:
    """Return the path of a shipped machine file, in the installed package or in the checkout."""
    for folder in _FOLDERS:
        path = folder / f"{name}.toml"
        if path.is_file():
            return path
    raise InputError(f"machine {name}: does not come with this installation", "give the path of a machine file")


def machine_file(name: str) -> Path:
    """Return the path that is given, or that of a shipped machine file where it is a bare name."""
    path = Path(name)
    return shipped_machine(name) if path.suffix == "" and path.name == name and not path.is_file() else path
