"""What the service is told when it starts."""

from __future__ import annotations

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
    max_map_pixels
        Larger maps and influence functions are refused once their size is known.
    """

    data: Path
    machine: Path
    simulate: bool = False
    speed: float = 1.0
    max_upload_bytes: int = 1 << 30
    max_map_pixels: int = 1 << 26
