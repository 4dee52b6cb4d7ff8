"""What the service is told when it starts."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Settings:
    """Settings of one service.

    Attributes
    ----------
    data
        Folder that holds every map, influence function, plan and run.
    machine
        Machine file: limits for planning, and the controller that runs are streamed to.
    simulate
        Stream runs to an emulated controller of their own instead.
    speed
        Seconds of an emulated controller per second of the clock on the wall.
    max_upload_bytes
        Larger bodies are refused while they arrive.
    """

    data: Path
    machine: Path
    simulate: bool = False
    speed: float = 1.0
    max_upload_bytes: int = 1 << 30


def default_data_folder() -> Path:
    """Return the folder in the user's state directory."""
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(state) / "ibfctl"
